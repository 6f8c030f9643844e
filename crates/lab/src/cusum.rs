//! Cumulative sums that find a lasting shift of a mean \[Page 1954\], with the run lengths that Siegmund's approximation
//! gives.
//!
//! # References
//!
//! - E. S. Page, *Continuous inspection schemes*, Biometrika 41, 1954.
//! - D. Siegmund, *Sequential Analysis*, Springer 1985, sec. X.2.

/// What is taken off every step: half of the smallest shift that matters, in standard deviations.
pub const SLACK: f64 = 0.5;
/// A step of more than so many standard deviations counts as this: one wild stride is no drift.
const WILD: f64 = 3.5;
/// What a discrete sum oversteps its boundary by, on average, at either end (Siegmund 1985).
const OVERSHOOT: f64 = 1.166;

/// Mean number of steps until a one-sided sum of normal steps of mean `shift` and standard deviation `scale` passes
/// `threshold`:
///
/// ```text
/// ARL = (exp(−2 Δ b) + 2 Δ b − 1) / (2 Δ²),   Δ = (shift − slack) / scale,   b = threshold / scale + 1.166
/// ```
///
/// # Example
///
/// Without a shift, with slack 0.5 and threshold 5, the table in Siegmund's book and many others say 930 to 938:
///
/// ```
/// let steps = stridemap_lab::run_length(0.0, 1.0, 5.0);
/// assert!((steps - 938.0).abs() < 1.0);
/// ```
#[must_use]
pub fn run_length(shift: f64, scale: f64, threshold: f64) -> f64 {
    let (drift, b) = ((shift - SLACK) / scale, threshold / scale + OVERSHOOT);
    let x = 2.0 * drift * b;
    // Near no drift at all the expression is 0 / 0; its limit is b².
    if x.abs() < 1e-4 { b * b } else { ((-x).exp() + x - 1.0) / (2.0 * drift * drift) }
}

/// False alarms in a step of `sums` one-sided sums whose means and scales were learned from `learned` steps: averaged
/// over what those leave unknown, normal for the mean (standard deviation 1/√n) and for the scale (1/√(2 n)).
fn false_alarm_rate(sums: usize, learned: usize, threshold: f64) -> f64 {
    const GRID: i32 = 12;
    let n = learned as f64;
    let (mut rate, mut weights) = (0.0, 0.0);
    for i in -GRID..=GRID {
        for j in -GRID..=GRID {
            let [u, v] = [i, j].map(|k| 3.0 * f64::from(k) / f64::from(GRID));
            let weight = (-0.5 * (u * u + v * v)).exp();
            let scale = (1.0 + v / (2.0 * n).sqrt()).max(0.3);
            rate += weight / run_length(u / n.sqrt(), scale, threshold);
            weights += weight;
        }
    }
    sums as f64 * rate / weights
}

/// The threshold with which so many sums, learned from so many steps, give at most this many false alarms a step.
#[must_use]
pub fn threshold_for(false_alarms: f64, sums: usize, learned: usize) -> f64 {
    let (mut low, mut high) = (1.0, 100.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if false_alarm_rate(sums, learned, middle) > false_alarms { low = middle } else { high = middle }
    }
    high
}

/// The smallest shift, in standard deviations, that is found after so many steps on average.
#[must_use]
pub fn shift_found_within(steps: f64, threshold: f64) -> f64 {
    let (mut low, mut high) = (SLACK, WILD + 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if run_length(middle, 1.0, threshold) > steps { low = middle } else { high = middle }
    }
    high
}

/// A two-sided sum of standardised steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cusum {
    up: f64,
    down: f64,
}

impl Cusum {
    /// Takes a step; the sum that is larger, with its sign.
    ///
    /// # Example
    ///
    /// Steps of 2 less a slack of 0.5:
    ///
    /// ```
    /// let mut sum = stridemap_lab::Cusum::default();
    /// let sums: Vec<f64> = [2.0, 2.0, 2.0].map(|step| sum.step(step)).to_vec();
    /// assert_eq!(sums, [1.5, 3.0, 4.5]);
    /// ```
    pub fn step(&mut self, step: f64) -> f64 {
        let step = step.clamp(-WILD, WILD);
        self.up = (self.up + step - SLACK).max(0.0);
        self.down = (self.down - step - SLACK).max(0.0);
        if self.up >= self.down { self.up } else { -self.down }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Means and scales learned from 60 steps, four sums (two components, both sides), at most 2 false alarms in 1,000:
    /// simulated over 400 robots there are 1.2 times as many (the approximation); a shift of two
    /// standard deviations is found as fast as is said.
    #[test]
    fn false_alarms_and_delays_are_those_of_a_simulation() {
        let (rate, learned) = (0.002, 60);
        let threshold = threshold_for(rate, 4, learned);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut alarms, mut steps, mut delay) = (0.0, 0.0, 0.0);
        const ROBOTS: usize = 400;
        for _ in 0..ROBOTS {
            let mut components = [(0.0, 1.0, Cusum::default()); 2];
            for (mean, scale, _) in &mut components {
                let seen: Vec<f64> = (0..learned).map(|_| normal()).collect();
                *mean = seen.iter().sum::<f64>() / learned as f64;
                *scale = (seen.iter().map(|x| (x - *mean).powi(2)).sum::<f64>() / (learned - 1) as f64).sqrt();
            }
            for _ in 0..500 {
                steps += 1.0;
                let over = components
                    .iter_mut()
                    .any(|(mean, scale, sum)| sum.step((normal() - *mean) / *scale).abs() > threshold);
                if over {
                    alarms += 1.0;
                    components.iter_mut().for_each(|c| c.2 = Cusum::default());
                }
            }
            let mut sum = Cusum::default();
            while sum.step(2.0 + normal()).abs() <= threshold {
                delay += 1.0;
            }
            delay += 1.0;
        }
        let found = alarms / steps;
        assert!(found < 1.5 * rate && found > 0.6 * rate, "{found} instead of {rate}");
        let mean = delay / ROBOTS as f64;
        let said = run_length(2.0, 1.0, threshold);
        assert!((mean / said - 1.0).abs() < 0.15, "{mean} instead of {said}");
        assert!((run_length(shift_found_within(10.0, threshold), 1.0, threshold) - 10.0).abs() < 1e-6);
    }
}
