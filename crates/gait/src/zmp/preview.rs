//! Preview control of the centre of mass: the cart–table model follows a future of zero-moment points \[Kajita03\].

use nalgebra::{Matrix4, RowVector3, RowVector4, Vector3, Vector4};

/// Gravity, m/s².
pub(crate) const GRAVITY_M_S2: f64 = 9.81;

/// Along one axis, with the centre of mass at constant height h:
///
/// ```text
/// x(k+1) = A x(k) + B u(k),   p = C x = x − (h / g) ẍ,   u the jerk          [Kajita03, eq. (10)]
/// minimise Σ (p_ref − p)² + R (Δu)²
/// u(k) = −G_i Σ (p − p_ref) − G_x x(k) − Σ_j G_d(j) p_ref(k + j)             [Kajita03, eq. (18)]
/// ```
///
/// with the gains from the Riccati equation of the system in which errors are summed up and states are changes.
///
/// # Example
///
/// A step of the reference by 0.1 m in three seconds, beyond what is seen at first: the mass leans towards it before, and arrives.
///
/// ```
/// use stridemap_gait::{Preview, PreviewAxis};
///
/// let preview = Preview::new(0.8, 0.01, 1.6);
/// let mut axis = PreviewAxis::default();
/// let step = |k: usize| if k >= 300 { 0.1 } else { 0.0 };
/// let mut worst: f64 = 0.0;
/// for k in 0..700 {
///     let ahead: Vec<f64> = (0..=preview.samples()).map(|j| step(k + j)).collect();
///     preview.advance(&mut axis, &ahead);
///     if k == 295 {
///         assert!(axis.position_m() > 0.02); // it has left before the step is asked for
///     }
///     if !(290..320).contains(&k) {
///         worst = worst.max((preview.zmp_m(&axis) - step(k + 1)).abs());
///     }
/// }
/// assert!(worst < 0.01, "{worst}");
/// assert!((axis.position_m() - 0.1).abs() < 1e-3);
/// ```
#[derive(Clone, Debug)]
pub struct Preview {
    period_s: f64,
    height_m: f64,
    of_sum: f64,
    of_state: RowVector3<f64>,
    of_future: Vec<f64>,
}

/// The centre of mass along one axis as planned.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreviewAxis {
    /// Position, velocity, acceleration.
    state: Vector3<f64>,
    sum: f64,
}

impl PreviewAxis {
    /// At rest.
    #[must_use]
    pub fn at(position_m: f64) -> Self {
        Self { state: Vector3::new(position_m, 0.0, 0.0), sum: 0.0 }
    }

    /// Position.
    #[must_use]
    pub fn position_m(&self) -> f64 {
        self.state[0]
    }

    /// The divergent component of motion, `x + ẋ / ω` with `ω = √(g / h)`.
    #[must_use]
    pub fn divergent_m(&self, height_m: f64) -> f64 {
        self.state[0] + self.state[1] * (height_m / GRAVITY_M_S2).sqrt()
    }
}

impl Preview {
    /// Weight of the change of jerk against the error of the zero-moment point, of \[Kajita03\].
    const R: f64 = 1e-6;

    /// Gains for a height of the centre of mass, a planning period, and so many seconds of future.
    #[must_use]
    pub fn new(height_m: f64, period_s: f64, future_s: f64) -> Self {
        const ITERATIONS: usize = 5000;
        let (t, samples) = (period_s, (future_s / period_s).round() as usize);
        let (b, c) =
            (Vector3::new(t * t * t / 6.0, t * t / 2.0, t), RowVector3::new(1.0, 0.0, -height_m / GRAVITY_M_S2));
        let a = Self::step_of(t);
        let mut big_a = Matrix4::zeros();
        big_a[(0, 0)] = 1.0;
        big_a.fixed_view_mut::<1, 3>(0, 1).copy_from(&(c * a));
        big_a.fixed_view_mut::<3, 3>(1, 1).copy_from(&a);
        let cb = (c * b)[0];
        let big_b = Vector4::new(cb, b[0], b[1], b[2]);
        let error = Vector4::new(1.0, 0.0, 0.0, 0.0);
        let mut p = error * error.transpose();
        let mut gain = RowVector4::zeros();
        let mut scale = 1.0;
        for _ in 0..ITERATIONS {
            scale = Self::R + big_b.dot(&(p * big_b));
            gain = (big_b.transpose() * p * big_a) / scale;
            let next = big_a.transpose() * p * (big_a - big_b * gain) + error * error.transpose();
            let change = (next - p).amax();
            p = 0.5 * (next + next.transpose());
            if change <= 1e-12 * p.amax() {
                break;
            }
        }
        let closed = (big_a - big_b * gain).transpose();
        let mut x = -(closed * p * error);
        let mut of_future = vec![-gain[0]];
        for _ in 1..samples {
            of_future.push(big_b.dot(&x) / scale);
            x = closed * x;
        }
        Self { period_s, height_m, of_sum: gain[0], of_state: gain.fixed_view::<1, 3>(0, 1).into_owned(), of_future }
    }

    fn step_of(t: f64) -> nalgebra::Matrix3<f64> {
        nalgebra::Matrix3::new(1.0, t, t * t / 2.0, 0.0, 1.0, t, 0.0, 0.0, 1.0)
    }

    /// Samples of the future that it looks at.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.of_future.len()
    }

    /// The zero-moment point of a planned state.
    #[must_use]
    pub fn zmp_m(&self, axis: &PreviewAxis) -> f64 {
        axis.state[0] - self.height_m / GRAVITY_M_S2 * axis.state[2]
    }

    /// One planning period; `ahead` is the reference now and at as many samples of the future as it looks at.
    pub fn advance(&self, axis: &mut PreviewAxis, ahead: &[f64]) {
        axis.sum += self.zmp_m(axis) - ahead.first().copied().unwrap_or_default();
        let future: f64 = self.of_future.iter().zip(ahead.iter().skip(1)).map(|(g, p)| g * p).sum();
        let jerk = -self.of_sum * axis.sum - (self.of_state * axis.state)[0] - future;
        let t = self.period_s;
        axis.state = Self::step_of(t) * axis.state + Vector3::new(t * t * t / 6.0, t * t / 2.0, t) * jerk;
    }
}
