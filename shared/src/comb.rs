//! Decimation of ADC codes by a comb: four moving sums of `ratio` samples each, in wrapping integers.
//!
//! The cheapest filter in front of a narrow band: four additions per code, no multiplication, exact (Hogenauer 1981). Its
//! zeros lie on the multiples of the output rate, so only what lies within the wanted band around them folds onto it:
//! with the band up to x of the output rate the fourth power of x / (1 - x), -90 dB for x = 0.0698. The pass band droops by
//! 1 - (sin pi x / pi x)^4 (0.2 dB at 0.0625), which [`crate::mesh_decimator`] undoes at its low rate.
//!
//! Sums wrap and their differences are right as long as `ratio^4` codes fit 32 bits: `ratio` up to 16.
//! Cost (Cortex-M4F in QEMU): see `tests/snapshots/instructions.txt`, about 6 instructions per code.

/// Most codes per call.
pub const MOST_CODES: usize = 128;
/// Largest ratio.
pub const HIGHEST_RATIO: u32 = 16;
const ORDER: usize = 4;
/// Middle of the converter's range.
const MIDDLE: u32 = 32_768;

/// Moving sums with their memory.
#[derive(Clone, Debug)]
pub struct Comb {
    ratio: u32,
    /// Codes of the output under way.
    filled: u32,
    sums: [u32; ORDER],
    earlier: [u32; ORDER],
}

impl Comb {
    /// A comb with the middle code as its past; `ratio` is limited to 1 to [`HIGHEST_RATIO`].
    pub fn new(ratio: u32) -> Self {
        let ratio = ratio.clamp(1, HIGHEST_RATIO);
        let mut comb = Self { ratio, filled: 0, sums: [0; ORDER], earlier: [0; ORDER] };
        let past = [MIDDLE as u16; ORDER * HIGHEST_RATIO as usize];
        comb.process(past.get(..ORDER * ratio as usize).unwrap_or_default(), 0.0, 0, &mut [0.0; ORDER]);
        comb
    }

    /// Codes per output.
    pub fn ratio(&self) -> u32 {
        self.ratio
    }

    /// Codes between the instant an output describes and the newest code it needed.
    pub fn delay_samples(&self) -> u32 {
        ORDER as u32 / 2 * (self.ratio - 1)
    }

    /// Means of at most [`MOST_CODES`] codes, in units of `per_code` above `zero`; the number of outputs written.
    pub fn process(&mut self, codes: &[u16], per_code: f32, zero: u16, outputs: &mut [f32]) -> usize {
        let codes = codes.get(..MOST_CODES).unwrap_or(codes);
        let gain = self.ratio.wrapping_mul(self.ratio).wrapping_mul(self.ratio).wrapping_mul(self.ratio);
        let scale = per_code / gain as f32;
        let offset = (MIDDLE as f32 - f32::from(zero)) * per_code;
        let below = MIDDLE.wrapping_mul(gain);
        let ratio = self.ratio as usize;
        let start = if self.filled == 0 { 0 } else { ratio.saturating_sub(self.filled as usize) };
        let (head, body) = codes.split_at_checked(start).unwrap_or((codes, &[]));
        let mut made = 0;
        if !head.is_empty() {
            self.filled += head.len() as u32;
            integrate(&mut self.sums, head, head.len(), outputs);
            made = usize::from(self.filled == self.ratio);
        }
        if made == 1 || start == 0 {
            let rest = outputs.get_mut(made..).unwrap_or_default();
            made += integrate(&mut self.sums, body, ratio, rest);
            self.filled = body.len().checked_rem(ratio).unwrap_or(0) as u32;
        }
        let mut earlier = self.earlier;
        for output in outputs.iter_mut().take(made) {
            let mut difference = output.to_bits();
            for earlier in &mut earlier {
                (*earlier, difference) = (difference, difference.wrapping_sub(*earlier));
            }
            *output = difference.wrapping_sub(below) as i32 as f32 * scale + offset;
        }
        self.earlier = earlier;
        made
    }
}

/// Sums of sums over the codes, the fourth kept (its bits) after every `ratio` of them; how many were kept. A function of
/// its own: the sums stay in registers.
#[inline(never)]
fn integrate(sums: &mut [u32; ORDER], codes: &[u16], ratio: usize, kept: &mut [f32]) -> usize {
    let [mut first, mut second, mut third, mut fourth] = *sums;
    let mut add = |code: u16| {
        first = first.wrapping_add(u32::from(code));
        second = second.wrapping_add(first);
        third = third.wrapping_add(second);
        fourth = fourth.wrapping_add(third);
        fourth
    };
    let mut groups = codes.chunks_exact(ratio.max(1));
    let mut count = 0;
    for (kept, group) in kept.iter_mut().zip(&mut groups) {
        let mut fours = group.chunks_exact(4);
        let mut newest = 0;
        for four in &mut fours {
            if let [a, b, c, d] = *four {
                add(a);
                add(b);
                add(c);
                newest = add(d);
            }
        }
        for &code in fours.remainder() {
            newest = add(code);
        }
        *kept = f32::from_bits(newest);
        count += 1;
    }
    for &code in groups.remainder() {
        add(code);
    }
    *sums = [first, second, third, fourth];
    count
}
