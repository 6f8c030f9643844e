//! The compass gait: two straight legs down a slope, integrated numerically.

use nalgebra::{Matrix2, Vector2};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_process::{
    Action, ActionDimension, Goal, MeanMap, ProcessError, ProcessSpec, Situation, State, StateDimension, Stride,
    StrideEnd, StrideProcess, clipped_action,
};

/// Step of the Runge-Kutta integration: energy over a swing to a part in 10¹⁰.
const TIME_STEP_S: f64 = 1e-3;
/// A swing that takes longer than this has stalled: more than four times the usual 0.7 s.
const LONGEST_SWING_S: f64 = 3.0;
/// The legs have passed each other by this much before a foot strike counts; scuffing is ignored,
/// as usual for legs without knees.
const PASSED_RAD: f64 = 1e-3;

/// Parameters of a [`CompassGait`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompassGaitParameters {
    /// Point mass of a leg; positive.
    pub leg_kg: f64,
    /// Point mass at the hip; not negative.
    pub hip_kg: f64,
    /// From the foot to the leg's mass, a; positive.
    pub foot_to_mass_m: f64,
    /// From the leg's mass to the hip, b; positive.
    pub mass_to_hip_m: f64,
    /// Slope, downhill positive; below 0.3 in magnitude.
    pub slope_rad: f64,
    /// Gravitational acceleration; positive.
    pub gravity_m_s2: f64,
    /// Largest torque between the legs, positive when it swings the free leg forward; not negative.
    pub max_hip_torque_nm: f64,
    /// The speed down the slope that is rewarded most: r = −(v − v_target)².
    pub target_m_s: f64,
    /// State after a reset: (stance angle, stance rate, swing rate).
    pub initial: [f64; 3],
    /// Standard deviation of each component of it; not negative.
    pub initial_std: f64,
}

impl Default for CompassGaitParameters {
    /// The machine of \[Goswami98\] on a slope of 3°, started at its gait.
    fn default() -> Self {
        Self {
            leg_kg: 5.0,
            hip_kg: 10.0,
            foot_to_mass_m: 0.5,
            mass_to_hip_m: 0.5,
            slope_rad: 3f64.to_radians(),
            gravity_m_s2: 9.81,
            max_hip_torque_nm: 5.0,
            target_m_s: 0.8,
            initial: [-0.2187, 1.0918, 0.3772],
            initial_std: 0.0,
        }
    }
}

/// The compass gait \[Goswami98\]: a hip, two legs with a point mass each, plastic foot strikes.
///
/// The section is just after a foot strike. Leg angles are from the vertical, positive when the leg
/// leans forward over its foot; the state is the stance angle `q₁` and both rates, since both feet on
/// the slope ι make `q₁ + q₂ = 2 ι`. The action is a torque between the legs, held over the stride.
///
/// ```text
/// swing:   M(q) q̈ + h(q, q̇) = (−τ, τ)                     conserves energy for τ = 0
/// strike:  angular momentum of all about the new foot, and of the trailing leg about the hip, are kept
/// ```
///
/// # Example
///
/// The passive gait on 3° and its stability; state and slopes are known from the literature.
///
/// ```
/// # use stridemap_map::*;
/// # use stridemap_process::*;
/// # use stridemap_testbed::*;
/// let gait = CompassGait::new(CompassGaitParameters::default())?;
/// let still = |_: &Situation| Action::from_slice(&[0.0]);
/// let found = fixed_point(&gait, &still, &[-0.22, 1.09, 0.38], &[1e-5; 3])?;
/// for (x, known) in found.state.iter().zip([-0.2187, 1.0918, 0.3772]) {
///     assert!((x - known).abs() < 1e-3);
/// }
/// assert!(found.spectral_radius() < 1.0);
/// # Ok::<(), MapError>(())
/// ```
#[derive(Clone, Debug)]
pub struct CompassGait {
    parameters: CompassGaitParameters,
    spec: ProcessSpec,
    state: Option<State>,
}

/// Angles and rates: (q₁, q₂, q̇₁, q̇₂), stance leg first.
type Full = [f64; 4];

impl CompassGait {
    /// A gait that must be reset before its first stride.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] naming the parameter.
    pub fn new(parameters: CompassGaitParameters) -> Result<Self, ProcessError> {
        let p = &parameters;
        let (positive, not_negative) = ("must be positive", "must be finite and not negative");
        for (name, value, holds, requirement) in [
            ("leg_kg", p.leg_kg, p.leg_kg > 0.0, positive),
            ("hip_kg", p.hip_kg, p.hip_kg >= 0.0, not_negative),
            ("foot_to_mass_m", p.foot_to_mass_m, p.foot_to_mass_m > 0.0, positive),
            ("mass_to_hip_m", p.mass_to_hip_m, p.mass_to_hip_m > 0.0, positive),
            ("slope_rad", p.slope_rad, p.slope_rad.abs() < 0.3, "must be within ±0.3"),
            ("gravity_m_s2", p.gravity_m_s2, p.gravity_m_s2 > 0.0, positive),
            ("max_hip_torque_nm", p.max_hip_torque_nm, p.max_hip_torque_nm >= 0.0, not_negative),
            ("target_m_s", p.target_m_s, true, "must be finite"),
            ("initial", p.initial[0], true, "must be finite"),
            ("initial", p.initial[1], true, "must be finite"),
            ("initial", p.initial[2], true, "must be finite"),
            ("initial_std", p.initial_std, p.initial_std >= 0.0, not_negative),
        ] {
            if !(value.is_finite() && holds) {
                return Err(ProcessError::Parameter { name, value, requirement });
            }
        }
        let names = ["stance_rad", "stance_rate_rad_s", "swing_rate_rad_s"];
        let spec = ProcessSpec {
            state: names.iter().map(|n| StateDimension { name: (*n).into() }).collect(),
            action: vec![ActionDimension {
                name: "hip_torque_nm".into(),
                lower: -p.max_hip_torque_nm,
                upper: p.max_hip_torque_nm,
            }],
            goal: Vec::new(),
        };
        Ok(Self { parameters, spec, state: None })
    }

    fn leg_m(&self) -> f64 {
        self.parameters.foot_to_mass_m + self.parameters.mass_to_hip_m
    }

    /// M(q).
    fn mass_matrix(&self, x: &Full) -> Matrix2<f64> {
        let p = &self.parameters;
        let (a, b, l, m) = (p.foot_to_mass_m, p.mass_to_hip_m, self.leg_m(), p.leg_kg);
        let coupling = -m * l * b * (x[0] - x[1]).cos();
        Matrix2::new((p.hip_kg + m) * l * l + m * a * a, coupling, coupling, m * b * b)
    }

    /// Kinetic and potential energy, in joules; the stance foot at height zero.
    #[cfg(test)]
    fn energy_j(&self, x: &Full) -> f64 {
        let p = &self.parameters;
        let (a, b, l, m) = (p.foot_to_mass_m, p.mass_to_hip_m, self.leg_m(), p.leg_kg);
        let rates = Vector2::new(x[2], x[3]);
        let kinetic = 0.5 * rates.dot(&(self.mass_matrix(x) * rates));
        let height = ((p.hip_kg + m) * l + m * a) * x[0].cos() - m * b * x[1].cos();
        kinetic + p.gravity_m_s2 * height
    }

    fn derivative(&self, x: &Full, torque: f64) -> Full {
        let p = &self.parameters;
        let (a, b, l, m, g) = (p.foot_to_mass_m, p.mass_to_hip_m, self.leg_m(), p.leg_kg, p.gravity_m_s2);
        let bend = m * l * b * (x[0] - x[1]).sin();
        let force = Vector2::new(
            bend * x[3] * x[3] + g * ((p.hip_kg + m) * l + m * a) * x[0].sin() - torque,
            -bend * x[2] * x[2] - g * m * b * x[1].sin() + torque,
        );
        // M is positive definite for positive masses: m b² ((m_H + m) l² + m a²) > (m l b)².
        let matrix = self.mass_matrix(x);
        let det = matrix.determinant();
        [
            x[2],
            x[3],
            (matrix.m22 * force.x - matrix.m12 * force.y) / det,
            (matrix.m11 * force.y - matrix.m12 * force.x) / det,
        ]
    }

    /// One step of the classical Runge-Kutta method.
    fn advance(&self, x: &Full, torque: f64, dt: f64) -> Full {
        let along = |k: &Full, h: f64| -> Full { std::array::from_fn(|i| x[i] + h * k[i]) };
        let k1 = self.derivative(x, torque);
        let k2 = self.derivative(&along(&k1, 0.5 * dt), torque);
        let k3 = self.derivative(&along(&k2, 0.5 * dt), torque);
        let k4 = self.derivative(&along(&k3, dt), torque);
        std::array::from_fn(|i| x[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    }

    /// Angular momenta of the three masses about the leading foot, and of the trailing leg about the
    /// hip. `pivot` says which leg turns about its foot on the ground: 0 the trailing one (before the
    /// strike), 1 the leading one (after it).
    fn momenta(&self, x: &Full, pivot: usize) -> Vector2<f64> {
        let p = &self.parameters;
        let (a, b, l, m) = (p.foot_to_mass_m, p.mass_to_hip_m, self.leg_m(), p.leg_kg);
        let along = |i: usize| Vector2::new(x[i].sin(), x[i].cos());
        let turning = |i: usize| x[2 + i] * Vector2::new(x[i].cos(), -x[i].sin());
        let hip_speed = l * turning(pivot);
        let hip = l * along(1); // from the leading foot
        let momentum = |mass: f64, r: Vector2<f64>, v: Vector2<f64>| mass * (r.x * v.y - r.y * v.x);
        let mut about_foot = momentum(p.hip_kg, hip, hip_speed);
        let mut about_hip = 0.0;
        for leg in 0..2 {
            let speed = if leg == pivot { a * turning(leg) } else { hip_speed - b * turning(leg) };
            about_foot += momentum(m, hip - b * along(leg), speed);
            if leg == 0 {
                about_hip = momentum(m, -b * along(leg), speed);
            }
        }
        Vector2::new(about_foot, about_hip)
    }

    /// The foot strike: rates that keep both momenta, then the legs change their names.
    fn strike(&self, x: &Full) -> Option<Full> {
        let before = self.momenta(x, 0);
        let first = self.momenta(&[x[0], x[1], 1.0, 0.0], 1);
        let second = self.momenta(&[x[0], x[1], 0.0, 1.0], 1);
        let rates = Matrix2::from_columns(&[first, second]).try_inverse()? * before;
        Some([x[1], x[0], rates.y, rates.x])
    }

    /// From just after one strike to just after the next: the state there, and the time.
    fn step(&self, state: &[f64], torque: f64) -> Result<(Full, f64), StrideEnd> {
        let slope = self.parameters.slope_rad;
        let mut x = [state[0], 2.0 * slope - state[0], state[1], state[2]];
        let mut time = 0.0;
        // Below zero the free foot, ahead of the other, is above the slope.
        let guard = |x: &Full| x[0] + x[1] - 2.0 * slope;
        let passed = |x: &Full| x[0] - x[1] > PASSED_RAD;
        while time < LONGEST_SWING_S {
            let next = self.advance(&x, torque, TIME_STEP_S);
            if next.iter().any(|v| !v.is_finite()) || next[0].abs() > std::f64::consts::FRAC_PI_2 {
                return Err(StrideEnd::Fell);
            }
            if passed(&x) && guard(&x) < 0.0 && guard(&next) >= 0.0 {
                let (mut low, mut high) = (0.0, TIME_STEP_S);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if guard(&self.advance(&x, torque, middle)) < 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                let at_strike = self.advance(&x, torque, high);
                let after = self.strike(&at_strike).ok_or(StrideEnd::Fell)?;
                return Ok((after, time + high));
            }
            x = next;
            time += TIME_STEP_S;
        }
        Err(StrideEnd::NoCrossing)
    }
}

impl MeanMap for CompassGait {
    fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError> {
        let found = at.state.len();
        if found != 3 {
            return Err(ProcessError::Length { what: "state", expected: 3, found });
        }
        let action = clipped_action(&self.spec, action)?;
        match self.step(&at.state, action[0]) {
            Ok((x, _)) => Ok(State::from_slice(&[x[0], x[2], x[3]])),
            Err(end) => Err(ProcessError::NoReturn { end }),
        }
    }
}

impl StrideProcess for CompassGait {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        let p = &self.parameters;
        let state: State = p
            .initial
            .iter()
            .map(|x| {
                let z: f64 = StandardNormal.sample(rng);
                x + p.initial_std * z
            })
            .collect();
        self.state = Some(state.clone());
        Ok(Situation { state, last_action: Action::from_slice(&[0.0]), goal: Goal::new() })
    }

    fn stride(&mut self, action: &[f64], _rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let action: Action = clipped_action(&self.spec, action)?;
        let state = self.state.take().ok_or(ProcessError::NotReset)?;
        let (state, reward, end) = match self.step(&state, action[0]) {
            Ok((x, time)) => {
                let next_state = State::from_slice(&[x[0], x[2], x[3]]);
                self.state = Some(next_state.clone());
                let stride_m = 2.0 * self.leg_m() * (0.5 * (x[1] - x[0])).sin();
                let reward = -(stride_m / time - self.parameters.target_m_s).powi(2);
                (next_state, reward, StrideEnd::Crossing)
            }
            Err(end) => (state, -1.0, end),
        };
        Ok(Stride { next: Situation { state, last_action: action, goal: Goal::new() }, reward, end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_map::{FixedPoint, fixed_point};

    fn gait(slope_deg: f64) -> CompassGait {
        CompassGait::new(CompassGaitParameters { slope_rad: slope_deg.to_radians(), ..Default::default() }).unwrap()
    }

    fn passive(slope_deg: f64, guess: &[f64]) -> FixedPoint {
        fixed_point(&gait(slope_deg), &|_| Action::from_slice(&[0.0]), guess, &[1e-5; 3]).unwrap()
    }

    #[test]
    fn a_swing_conserves_energy_and_a_torque_does_work() {
        let gait = gait(3.0);
        for torque in [0.0, 2.0] {
            let mut x = [-0.2187, 0.3234, 1.0918, 0.3772];
            let (start, mut work) = (gait.energy_j(&x), 0.0);
            for _ in 0..700 {
                let next = gait.advance(&x, torque, TIME_STEP_S);
                work += torque * ((next[1] - x[1]) - (next[0] - x[0]));
                x = next;
            }
            let error = (gait.energy_j(&x) - start - work).abs();
            assert!(error < 1e-8 * start.abs(), "{error} J of {start}");
        }
    }

    /// Against the impulse at the new foot: it changes linear momentum as it must, keeps the angular
    /// momentum about that foot, takes energy, and leaves the new foot at rest.
    #[test]
    fn a_strike_is_an_impulse_at_the_leading_foot() {
        let gait = gait(3.0);
        let before = [0.3234, -0.2187, 1.5, 1.8];
        let after = gait.strike(&before).unwrap();
        // Velocities of hip, trailing mass and leading mass, before and after, from scratch.
        let unit = |q: f64| Vector2::new(q.cos(), -q.sin());
        let (trail, lead) = (unit(before[0]), unit(before[1]));
        let v0 = [trail * 1.5, 0.5 * trail * 1.5, trail * 1.5 - 0.5 * lead * 1.8];
        let (p_lead, p_trail) = (after[2], after[3]);
        let v1 = [lead * p_lead, lead * p_lead - 0.5 * trail * p_trail, 0.5 * lead * p_lead];
        let r = |q: f64| Vector2::new(q.sin(), q.cos());
        let hip = r(before[1]);
        let places = [hip, hip - 0.5 * r(before[0]), 0.5 * hip];
        let masses = [10.0, 5.0, 5.0];
        let mut gained = [0.0; 2];
        let (mut e0, mut e1) = (0.0, 0.0);
        for i in 0..3 {
            let dv = v1[i] - v0[i];
            gained[0] += masses[i] * (places[i].x * dv.y - places[i].y * dv.x);
            e0 += 0.5 * masses[i] * v0[i].norm_squared();
            e1 += 0.5 * masses[i] * v1[i].norm_squared();
        }
        let (dv, arm) = (v1[1] - v0[1], places[1] - hip);
        gained[1] = 5.0 * (arm.x * dv.y - arm.y * dv.x);
        assert!(gained.iter().all(|g| g.abs() < 1e-12), "{gained:?}");
        assert!(e1 < e0 && e1 > 0.0);
    }

    /// The first period doubling of this machine is at a slope of 4.37° [Goswami98]: a multiplier
    /// leaves through −1 there.
    #[test]
    fn the_gait_loses_stability_by_a_flip_where_it_should() {
        let mut guess = State::from_slice(&[-0.2187, 1.0918, 0.3772]);
        let mut radii = Vec::new();
        for slope in [3.0, 3.4, 3.8, 4.1, 4.3, 4.45] {
            let found = passive(slope, &guess);
            guess = found.state.clone();
            radii.push((slope, found.spectral_radius(), found.multipliers[0].re));
        }
        assert!(radii[..5].iter().all(|r| r.1 < 1.0), "{radii:?}");
        let (_, radius, multiplier) = radii[5];
        assert!(radius > 1.0 && multiplier < -1.0, "{radii:?}");
    }

    #[test]
    fn what_cannot_walk_falls_or_stalls() {
        let gait = gait(3.0);
        let end = |state: [f64; 3]| match gait.mean_next_state(&state.into(), &[0.0]) {
            Err(ProcessError::NoReturn { end }) => end,
            other => panic!("{other:?}"),
        };
        assert_eq!(end([-0.2, -1.0, 0.0]), StrideEnd::Fell); // backwards
        let bad = CompassGaitParameters { leg_kg: 0.0, ..Default::default() };
        assert!(CompassGait::new(bad).unwrap_err().to_string().starts_with("leg_kg"));
    }
}
