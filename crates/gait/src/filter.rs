//! A first-order low-pass filter.

/// First-order low-pass filter `τ ẏ = x − y`, discretised by backward Euler:
/// `y ← y + (x − y) dt / (τ + dt)`.
///
/// The first input after a reset passes unchanged, so that a constant signal has no transient.
///
/// # Example
///
/// With `τ = dt` each step closes half of the gap:
///
/// ```
/// let mut filter = stridemap_gait::LowPass::new(0.01);
/// assert_eq!(filter.update(0.0, 0.01), 0.0);
/// assert_eq!(filter.update(1.0, 0.01), 0.5);
/// assert_eq!(filter.update(1.0, 0.01), 0.75);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass {
    time_constant_s: f64,
    value: Option<f64>,
}

impl LowPass {
    /// A filter with time constant `τ` ≥ 0; 0 passes the signal unchanged.
    #[must_use]
    pub const fn new(time_constant_s: f64) -> Self {
        Self { time_constant_s, value: None }
    }

    /// Feeds one sample taken `dt_s` > 0 after the last and returns the filtered value.
    pub fn update(&mut self, input: f64, dt_s: f64) -> f64 {
        let next = match self.value {
            None => input,
            Some(y) => y + (input - y) * dt_s / (self.time_constant_s + dt_s),
        };
        self.value = Some(next);
        next
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.value = None;
    }
}
