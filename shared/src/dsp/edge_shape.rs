//! The slope of one edge between its samples, as smooth pieces with kinks where a ramp begins or ends.
//!
//! Mesh stiffness ramps begin and end abruptly: the slope of the acceleration jumps there, while between two kinks it
//! is a piece of a ring and very smooth. A difference quotient rounds every kink and so moves the ends of the edge
//! and lowers its steepest slope. But the differences of neighbouring samples are the exact means of the slope over
//! the cells between them, and from means both can be had back:
//!
//! * inside a cell the slope is the cubic through five cells' means (least squares) that fits best among the
//!   five groups holding the cell, so that no group reaches across a kink without need (A. Harten et al., "Uniformly
//!   high order accurate essentially non-oscillatory schemes III", J. Comput. Phys. 71, 1987);
//! * a cell that no group fits holds a kink when its neighbours' cubics, continued into it, differ: the mean tells
//!   how much of the cell belongs to either (A. Harten, "ENO schemes with subcell resolution", J. Comput. Phys. 83,
//!   1989). Cells too crowded with kinks for cubics keep their mean.
//!
//! Noise makes cubics fit badly, so the limits below decide what counts as a kink: 0.5 % of the edge's height at ten
//! cells per rise time is what the tests hold. Positions are ages in cells, growing into the past; slopes are per
//! cell, upwards in time.

/// Cells of one cubic.
const GROUP: usize = 5;
/// Misfit, relative to the steepest slope, that one cell off the middle of a group is worth.
const CELL_OFFSET_PRICE: f32 = 0.005;
/// Misfit above which a cell may hold a kink, and above which it has no cubic.
const MISFIT: [f32; 2] = [0.003, 0.05];
/// Least jump of the slope at a kink, relative to the steepest slope.
const JUMP: f32 = 0.25;

/// A cubic of the slope.
#[derive(Clone, Copy)]
struct Piece {
    /// Age of the point about which it is expanded.
    centre: f32,
    /// Coefficients, ascending.
    powers: [f32; 4],
    /// Squared misfit, and the same with the price for being off the middle.
    misfit: f32,
    cost: f32,
}

impl Piece {
    const NONE: Self = Self { centre: 0.0, powers: [0.0; 4], misfit: f32::INFINITY, cost: f32::INFINITY };

    fn slope(&self, age: f32) -> f32 {
        let x = age - self.centre;
        let [a, b, c, d] = self.powers;
        a + x * (b + x * (c + x * d))
    }

    /// Mean over a cell, by Simpson's rule, which is exact.
    fn mean(&self, cell: usize) -> f32 {
        let age = cell as f32;
        (self.slope(age) + 4.0 * self.slope(age + 0.5) + self.slope(age + 1.0)) / 6.0
    }
}

/// A point of the edge.
#[derive(Clone, Copy)]
pub struct Point {
    /// Age in cells.
    pub age: f32,
    /// Value there.
    pub value: f32,
}

/// Values at the borders of fewer than `MOST` cells and the slope in between.
pub struct EdgeShape<const MOST: usize> {
    values: [f32; MOST],
    pieces: [Piece; MOST],
    cells: usize,
    /// About the steepest slope.
    scale: f32,
}

impl<const MOST: usize> EdgeShape<MOST> {
    /// Shape from the values at the borders of `cells` cells, the newest first, of an edge that rises with time;
    /// `scale` is about its steepest slope.
    pub fn new(cells: usize, scale: f32, value: impl Fn(u32) -> f32) -> Self {
        let cells = cells.min(MOST - 1);
        let mut values = [0.0; MOST];
        for (value_at, index) in values.iter_mut().zip(0..=cells as u32) {
            *value_at = value(index);
        }
        let mut pieces = [Piece::NONE; MOST];
        let used = values.get(..=cells).unwrap_or_default();
        for (first, borders) in used.windows(GROUP + 1).enumerate() {
            let &[u, v, w, x, y, z] = borders else { continue };
            let [p, q, r, s, t] = [u - v, v - w, w - x, x - y, y - z];
            // Least squares in the orthogonal polynomials of five points; what the quartic takes up is the misfit,
            // and so is the cubic's part, which is small wherever five cells are enough.
            let [even, odd] = [p + t, t - p];
            let [inner_even, inner_odd] = [q + s, s - q];
            let quadratic = (2.0 * (even - r) - inner_even) / 14.0;
            let cubic = (odd - 2.0 * inner_odd) / 12.0;
            let quartic = even - 4.0 * inner_even + 6.0 * r;
            let misfit = 14.4 * cubic * cubic + quartic * quartic / 70.0;
            let centre = first as f32 + 0.5 * GROUP as f32;
            // Means to values: the mean of x^2 over a cell is x^2 + 1/12, that of x^3 is x^3 + x/4.
            let powers = [
                0.2 * (even + inner_even + r) - (2.0 + 1.0 / 12.0) * quadratic,
                0.1 * (2.0 * odd + inner_odd) - (3.4 + 0.25) * cubic,
                quadratic,
                cubic,
            ];
            for (piece, off) in pieces.iter_mut().skip(first).zip(0..GROUP) {
                let price = CELL_OFFSET_PRICE * scale * (off as f32 - (GROUP / 2) as f32);
                let cost = misfit + price * price;
                if cost < piece.cost {
                    *piece = Piece { centre, powers, misfit, cost };
                }
            }
        }
        let limit = MISFIT[1] * scale;
        for (piece, pair) in pieces.iter_mut().zip(used.windows(2)) {
            if piece.misfit > limit * limit {
                piece.powers = [pair[0] - pair[1], 0.0, 0.0, 0.0];
            }
        }
        Self { values, pieces, cells, scale }
    }

    fn value(&self, border: usize) -> f32 {
        self.values.get(border).copied().unwrap_or_default()
    }

    fn mean(&self, cell: usize) -> f32 {
        self.value(cell) - self.value(cell + 1)
    }

    fn piece(&self, cell: usize) -> Option<&Piece> {
        self.pieces.get(..self.cells)?.get(cell)
    }

    /// The steepest cell among the one at `age` and its neighbours.
    pub fn steepest_cell(&self, age: f32) -> usize {
        let cell = age as usize;
        let mut best = cell;
        for near in [cell.saturating_sub(1), cell + 1] {
            if near < self.cells && self.mean(near) > self.mean(best) {
                best = near;
            }
        }
        best
    }

    /// The pieces on either side of a kink in the cell and the inner one's share of it.
    fn kink(&self, cell: usize, inner: usize, outer: usize) -> Option<(&Piece, &Piece, f32)> {
        let limit = MISFIT[0] * self.scale;
        if self.piece(cell)?.misfit <= limit * limit {
            return None;
        }
        let (inner, outer) = (self.piece(inner)?, self.piece(outer)?);
        let (from, to) = (inner.mean(cell), outer.mean(cell));
        let share = (self.mean(cell) - to) / (from - to);
        let inside = (0.0..1.0).contains(&share) && (from - to).abs() > JUMP * self.scale;
        inside.then_some((inner, outer, share))
    }

    /// Walks from `cell` into the past or towards the present to where the slope falls below `share` of the
    /// steepest slope, which grows with what is met. `None` when the cells end before.
    pub fn end(&self, mut cell: usize, past: bool, share: f32, steepest: &mut f32) -> Option<Point> {
        let direction = if past { 1.0 } else { -1.0 };
        loop {
            let own = self.piece(cell)?;
            let (older, newer) = (cell + 1, cell.wrapping_sub(1));
            let (border, inner, outer) = if past { (cell, newer, older) } else { (older, older, newer) };
            let (first, second, part) = self.kink(cell, inner, outer).unwrap_or((own, own, 1.0));
            let (mut age, mut value) = (border as f32, self.value(border));
            for (piece, length) in [(first, part), (second, 1.0 - part)] {
                let step = direction * length;
                let [from, middle, to] = [0.0, 0.5, 1.0].map(|share| piece.slope(age + share * step));
                *steepest = steepest.max(from).max(middle).max(to);
                let threshold = share * *steepest;
                if from < threshold {
                    return Some(Point { age, value });
                }
                if to < threshold {
                    let step = step * (from - threshold) / (from - to);
                    return Some(Point { age: age + step, value: value - 0.5 * step * (from + threshold) });
                }
                age += step;
                value -= 0.5 * step * (from + to);
            }
            cell = outer;
        }
    }

    /// Age at which the edge between two points first reaches `level`.
    pub fn crossing(&self, begin: Point, end: Point, level: f32) -> f32 {
        let mut from = begin;
        for cell in (0..=begin.age as usize).rev() {
            let Some(piece) = self.piece(cell) else { continue };
            let border = cell as f32;
            let to = if border > end.age { Point { age: border, value: self.value(cell) } } else { end };
            let length = from.age - to.age;
            if to.value >= level && length > 0.0 {
                // A parabola through both ends with the piece's curvature.
                let bend = (piece.slope(to.age) - piece.slope(from.age)) * length;
                let start = to.value - from.value - 0.5 * bend;
                let rest = (level - from.value).max(0.0);
                let root = crate::math::sqrt((start * start + 2.0 * bend * rest).max(0.0));
                let part = if start + root > 0.0 { (2.0 * rest / (start + root)).min(1.0) } else { 0.0 };
                return from.age - part * length;
            }
            if border <= end.age {
                break;
            }
            from = to;
        }
        end.age
    }
}
