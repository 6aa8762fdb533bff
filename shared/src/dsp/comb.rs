//! Decimation of ADC codes by a comb: four moving sums of `ratio` samples each, in wrapping integers.
//!
//! The cheapest filter in front of a narrow band: four additions per code, no multiplication, exact (Hogenauer 1981).
//! Its zeros lie on the multiples of the output rate, so only what lies within the wanted band around them folds onto
//! it: with the band up to x of the output rate the fourth power of x / (1 - x), -90 dB for x = 0.0698. The pass band
//! droops by 1 - (sin pi x / pi x)^4 (0.2 dB at 0.0625), which [`crate::mesh_decimator`] undoes at its low rate.
//!
//! Sums wrap and their differences are right as long as `ratio^4` codes fit 32 bits: `ratio` up to 16.
//! Cost (Cortex-M4F in QEMU): 7 instructions per code at a ratio of 16, 9 at 7.

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
    #[inline(never)]
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
        let [mut first, mut second, mut third, mut fourth] = self.earlier;
        for output in outputs.iter_mut().take(made) {
            let sum = output.to_bits();
            let once = sum.wrapping_sub(first);
            let twice = once.wrapping_sub(second);
            let thrice = twice.wrapping_sub(third);
            let mean = thrice.wrapping_sub(fourth).wrapping_sub(below) as i32;
            (first, second, third, fourth) = (sum, once, twice, thrice);
            *output = mean as f32 * scale + offset;
        }
        self.earlier = [first, second, third, fourth];
        made
    }
}

/// Sums of sums over the codes, the fourth kept (its bits) after every `ratio` of them; how many were kept.
#[inline(never)]
fn integrate(sums: &mut [u32; ORDER], codes: &[u16], ratio: usize, kept: &mut [f32]) -> usize {
    match ratio {
        6 => integrate_groups::<6>(sums, codes, kept),
        7 => integrate_groups::<7>(sums, codes, kept),
        8 => integrate_groups::<8>(sums, codes, kept),
        9 => integrate_groups::<9>(sums, codes, kept),
        10 => integrate_groups::<10>(sums, codes, kept),
        12 => integrate_groups::<12>(sums, codes, kept),
        14 => integrate_groups::<14>(sums, codes, kept),
        16 => integrate_groups::<16>(sums, codes, kept),
        ratio => {
            let mut all = Integrators(*sums);
            let mut groups = codes.chunks_exact(ratio.max(1));
            let mut count = 0;
            for (kept, group) in kept.iter_mut().zip(&mut groups) {
                group.iter().for_each(|&code| all.add(code));
                *kept = f32::from_bits(all.0[ORDER - 1]);
                count += 1;
            }
            groups.remainder().iter().for_each(|&code| all.add(code));
            *sums = all.0;
            count
        }
    }
}

/// The same for a ratio known to the compiler, which leaves no loop in a group: half the price. A function of its
/// own: the sums stay in registers.
#[inline(never)]
fn integrate_groups<const RATIO: usize>(sums: &mut [u32; ORDER], codes: &[u16], kept: &mut [f32]) -> usize {
    let mut all = Integrators(*sums);
    let mut groups = codes.chunks_exact(RATIO);
    let mut count = 0;
    for (kept, group) in kept.iter_mut().zip(&mut groups) {
        if let Some(group) = group.first_chunk::<RATIO>() {
            group.iter().for_each(|&code| all.add(code));
        }
        *kept = f32::from_bits(all.0[ORDER - 1]);
        count += 1;
    }
    groups.remainder().iter().for_each(|&code| all.add(code));
    *sums = all.0;
    count
}

/// The four sums.
struct Integrators([u32; ORDER]);

impl Integrators {
    #[inline(always)]
    fn add(&mut self, code: u16) {
        let [first, second, third, fourth] = &mut self.0;
        *first = first.wrapping_add(u32::from(code));
        *second = second.wrapping_add(*first);
        *third = third.wrapping_add(*second);
        *fourth = fourth.wrapping_add(*third);
    }
}
