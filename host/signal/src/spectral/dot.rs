//! Sums of products, the inner loop of resampling and of single lines.

/// Sums that one is split into, so that they need not wait for each other.
const LANES: usize = 8;

/// Sum of the products of `x` with as many `weights`.
///
/// # Panics
/// If there are fewer weights.
pub fn dot(x: &[f64], weights: &[f64]) -> f64 {
    let (x_blocks, x_rest) = x.as_chunks::<LANES>();
    let (w_blocks, w_rest) = weights[..x.len()].as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (x, w) in x_blocks.iter().zip(w_blocks) {
        for lane in 0..LANES {
            sums[lane] += x[lane] * w[lane];
        }
    }
    let rest: f64 = x_rest.iter().zip(w_rest).map(|(x, w)| x * w).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::dot;

    #[test]
    fn theory_products_of_any_length_add_up() {
        for length in [0, 1, 7, 8, 9, 64, 100] {
            let x: Vec<f64> = (0..length).map(f64::from).collect();
            let expected: f64 = x.iter().map(|x| x * x).sum();
            assert_eq!(dot(&x, &x), expected, "{length}");
        }
    }
}
