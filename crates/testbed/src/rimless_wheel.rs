//! The rimless wheel: the simplest walker, with a return map in closed form.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_process::{
    Action, ActionDimension, Goal, MeanMap, ProcessError, ProcessSpec, Situation, State, StateDimension, Stride,
    StrideEnd, StrideProcess, clipped_action,
};

/// Parameters of a [`RimlessWheel`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RimlessWheelParameters {
    /// Length of a spoke; positive.
    pub spoke_m: f64,
    /// Half the angle between two spokes, above 0 and below π/4.
    pub half_angle_rad: f64,
    /// Slope of the ground, downhill positive; below π/4 in magnitude.
    pub slope_rad: f64,
    /// Standard deviation of the slope from step to step \[BT09\]; not negative.
    pub slope_std_rad: f64,
    /// Moment of inertia about the hub over m ℓ²; not negative. 0: all mass in the hub.
    pub inertia_ratio: f64,
    /// Gravitational acceleration; positive.
    pub gravity_m_s2: f64,
    /// Most work that one push-off may do, per mass; not negative.
    pub max_push_off_j_kg: f64,
    /// The speed that is rewarded most: r = −(Ω′ − Ω_target)².
    pub target_rad_s: f64,
    /// Bounds of the uniform distribution of the speed after a reset, the lower one first.
    pub initial_rad_s: [f64; 2],
}

impl Default for RimlessWheelParameters {
    /// Eight spokes of 1 m on a slope of 0.08 rad, all mass in the hub.
    fn default() -> Self {
        Self {
            spoke_m: 1.0,
            half_angle_rad: std::f64::consts::PI / 8.0,
            slope_rad: 0.08,
            slope_std_rad: 0.0,
            inertia_ratio: 0.0,
            gravity_m_s2: 9.81,
            max_push_off_j_kg: 1.0,
            target_rad_s: 1.2,
            initial_rad_s: [0.9, 1.6],
        }
    }
}

/// A wheel of spokes without a rim rolling down a slope \[McGeer90, sec. 2; Coleman98, ch. 2\].
///
/// The section is just after a spoke has struck the ground; the state is the speed Ω there. The
/// action is the work of a push-off along the stride, per mass, so that it may walk on the level.
/// With half angle α, slope ι, inertia ratio j, push-off w:
///
/// ```text
/// swing:   Ω₋² = Ω² + (2 g/ℓ · (cos(ι − α) − cos(ι + α)) + 2 w/ℓ²) / (1 + j)    energy
/// strike:  Ω′ = η Ω₋,   η = (cos 2α + j) / (1 + j)              angular momentum about the new foot
/// ```
///
/// Fixed point `Ω* = η √(c / (1 − η²))` with c the energy term, multiplier `η²`.
/// The wheel stalls (`NoCrossing`) if it does not get over the vertical, and falls (`Fell`) if a
/// spoke would have to pull on the ground; both with reward −1.
///
/// # Example
///
/// ```
/// # use stridemap_map::*;
/// # use stridemap_process::*;
/// # use stridemap_testbed::*;
/// let wheel = RimlessWheel::new(RimlessWheelParameters::default())?;
/// let found = fixed_point(&wheel, &|_| Action::from_slice(&[0.0]), &[1.5], &[1e-4])?;
/// // α = π/8: η = cos(π/4), so η² = 1/2 and Ω*² = c = 4 g/ℓ sin α sin ι.
/// let c = 4.0 * 9.81 * f64::sin(std::f64::consts::PI / 8.0) * f64::sin(0.08);
/// assert!((found.state[0] - c.sqrt()).abs() < 1e-9);
/// assert!((found.multipliers[0].re - 0.5).abs() < 1e-7);
/// # Ok::<(), MapError>(())
/// ```
#[derive(Clone, Debug)]
pub struct RimlessWheel {
    parameters: RimlessWheelParameters,
    spec: ProcessSpec,
    speed_rad_s: Option<f64>,
}

impl RimlessWheel {
    /// A wheel that must be reset before its first stride.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] naming the parameter.
    pub fn new(parameters: RimlessWheelParameters) -> Result<Self, ProcessError> {
        use std::f64::consts::FRAC_PI_4;
        let p = &parameters;
        let not_negative = "must be finite and not negative";
        for (name, value, holds, requirement) in [
            ("spoke_m", p.spoke_m, p.spoke_m > 0.0, "must be positive"),
            (
                "half_angle_rad",
                p.half_angle_rad,
                p.half_angle_rad > 0.0 && p.half_angle_rad < FRAC_PI_4,
                "must be above 0 and below π/4",
            ),
            ("slope_rad", p.slope_rad, p.slope_rad.abs() < FRAC_PI_4, "must be within ±π/4"),
            ("slope_std_rad", p.slope_std_rad, p.slope_std_rad >= 0.0, not_negative),
            ("inertia_ratio", p.inertia_ratio, p.inertia_ratio >= 0.0, not_negative),
            ("gravity_m_s2", p.gravity_m_s2, p.gravity_m_s2 > 0.0, "must be positive"),
            ("max_push_off_j_kg", p.max_push_off_j_kg, p.max_push_off_j_kg >= 0.0, not_negative),
            ("target_rad_s", p.target_rad_s, true, "must be finite"),
            ("initial_rad_s", p.initial_rad_s[0], true, "must be finite"),
            (
                "initial_rad_s",
                p.initial_rad_s[1],
                p.initial_rad_s[1] >= p.initial_rad_s[0],
                "must be finite, the lower bound first",
            ),
        ] {
            if !(value.is_finite() && holds) {
                return Err(ProcessError::Parameter { name, value, requirement });
            }
        }
        let spec = ProcessSpec {
            state: vec![StateDimension { name: "speed_rad_s".into() }],
            action: vec![ActionDimension { name: "push_off_j_kg".into(), lower: 0.0, upper: p.max_push_off_j_kg }],
            goal: Vec::new(),
        };
        Ok(Self { parameters, spec, speed_rad_s: None })
    }

    /// The share of the speed that is left after a strike, η.
    #[must_use]
    pub fn strike_ratio(&self) -> f64 {
        let p = &self.parameters;
        ((2.0 * p.half_angle_rad).cos() + p.inertia_ratio) / (1.0 + p.inertia_ratio)
    }

    /// The fixed point in closed form under a constant push-off; `None` if the wheel does not roll.
    #[must_use]
    pub fn fixed_point_rad_s(&self, push_off_j_kg: f64) -> Option<f64> {
        let eta = self.strike_ratio();
        let energy = self.energy_rad2_s2(self.parameters.slope_rad, push_off_j_kg);
        let speed = eta * (energy / (1.0 - eta * eta)).sqrt();
        self.step(speed, self.parameters.slope_rad, push_off_j_kg).is_ok().then_some(speed)
    }

    /// Gain of Ω² over a swing: the energy term c.
    fn energy_rad2_s2(&self, slope_rad: f64, push_off_j_kg: f64) -> f64 {
        let p = &self.parameters;
        let (from, to) = (slope_rad - p.half_angle_rad, slope_rad + p.half_angle_rad);
        let fall = 2.0 * p.gravity_m_s2 / p.spoke_m * (from.cos() - to.cos());
        (fall + 2.0 * push_off_j_kg / p.spoke_m.powi(2)) / (1.0 + p.inertia_ratio)
    }

    /// One stride: the speed after the next strike, or how it ended without one.
    fn step(&self, speed: f64, slope_rad: f64, push_off_j_kg: f64) -> Result<f64, StrideEnd> {
        let p = &self.parameters;
        let (from, to) = (slope_rad - p.half_angle_rad, slope_rad + p.half_angle_rad);
        let rate = p.gravity_m_s2 / p.spoke_m;
        // The push-off comes after the vertical, so it does not help the wheel over it.
        let barrier = 2.0 * rate * (1.0 - from.cos()) / (1.0 + p.inertia_ratio);
        if from < 0.0 && (speed <= 0.0 || speed * speed <= barrier) {
            return Err(StrideEnd::NoCrossing);
        }
        let before_strike = speed * speed + self.energy_rad2_s2(slope_rad, push_off_j_kg);
        if before_strike <= 0.0 {
            return Err(StrideEnd::NoCrossing);
        }
        // Force along the spoke, m g cos θ − m ℓ θ̇²: least at one of the ends.
        if speed * speed > rate * from.cos() || before_strike > rate * to.cos() {
            return Err(StrideEnd::Fell);
        }
        Ok(self.strike_ratio() * before_strike.sqrt())
    }
}

impl MeanMap for RimlessWheel {
    fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError> {
        let &[speed] = at.state.as_slice() else {
            let found = at.state.len();
            return Err(ProcessError::Length { what: "state", expected: 1, found });
        };
        let action = clipped_action(&self.spec, action)?;
        match self.step(speed, self.parameters.slope_rad, action[0]) {
            Ok(next) => Ok(State::from_slice(&[next])),
            Err(end) => Err(ProcessError::NoReturn { end }),
        }
    }
}

impl StrideProcess for RimlessWheel {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        use rand::Rng;
        let [low, high] = self.parameters.initial_rad_s;
        let speed = low + (high - low) * rng.random::<f64>();
        self.speed_rad_s = Some(speed);
        Ok(Situation { state: State::from_slice(&[speed]), last_action: Action::from_slice(&[0.0]), goal: Goal::new() })
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let action = clipped_action(&self.spec, action)?;
        let speed = self.speed_rad_s.take().ok_or(ProcessError::NotReset)?;
        let z: f64 = StandardNormal.sample(rng);
        let slope = self.parameters.slope_rad + self.parameters.slope_std_rad * z;
        let (speed, reward, end) = match self.step(speed, slope, action[0]) {
            Ok(next) => {
                self.speed_rad_s = Some(next);
                (next, -(next - self.parameters.target_rad_s).powi(2), StrideEnd::Crossing)
            }
            Err(end) => (speed, -1.0, end),
        };
        let next = Situation { state: State::from_slice(&[speed]), last_action: action, goal: Goal::new() };
        Ok(Stride { next, reward, end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use stridemap_map::{ReturnLine, fixed_point};
    use stridemap_process::Action;

    fn wheel(change: impl Fn(&mut RimlessWheelParameters)) -> RimlessWheel {
        let mut parameters = RimlessWheelParameters::default();
        change(&mut parameters);
        RimlessWheel::new(parameters).unwrap()
    }

    /// Newton's fixed point and multiplier are the closed forms, with inertia and push-off.
    #[test]
    fn fixed_point_and_multiplier_are_the_known_ones() {
        for (alpha, slope, inertia, push) in [(0.3, 0.08, 0.0, 0.0), (0.25, 0.05, 0.4, 0.0), (0.3, 0.0, 0.1, 0.9)] {
            let wheel = wheel(|p| {
                (p.half_angle_rad, p.slope_rad, p.inertia_ratio) = (alpha, slope, inertia);
            });
            let exact = wheel.fixed_point_rad_s(push).unwrap();
            let action = Action::from_slice(&[push]);
            let found = fixed_point(&wheel, &|_| action.clone(), &[exact * 1.02], &[1e-4]).unwrap();
            assert!((found.state[0] - exact).abs() < 1e-9);
            let eta = ((2.0 * alpha).cos() + inertia) / (1.0 + inertia);
            assert!((found.spectral_radius() - eta * eta).abs() < 1e-6);
        }
    }

    /// The swing, integrated: θ̈ = (g/ℓ) sin θ / (1 + j) from ι − α to ι + α.
    #[test]
    fn the_swing_agrees_with_its_equation_of_motion() {
        let wheel = wheel(|p| (p.inertia_ratio, p.half_angle_rad) = (0.3, 0.3));
        let (alpha, incline, speed) = (0.3, 0.08, 1.3);
        let (mut theta, mut rate, dt) = (incline - alpha, speed, 1e-6);
        while theta < incline + alpha {
            let middle = theta + 0.5 * dt * rate;
            rate += dt * 9.81 * f64::sin(middle) / 1.3;
            theta = middle + 0.5 * dt * rate;
        }
        // Angular momentum about the new foot: ℓ² cos 2α + j before, ℓ² + j after.
        let after = rate * (f64::cos(0.6) + 0.3) / 1.3;
        let next = wheel.mean_next_state(&[speed].into(), &[0.0]).unwrap()[0];
        assert!((next - after).abs() < 1e-5, "{next} is not {after}");
    }

    /// Pairs two strides apart, close to the fixed point: slope η⁴.
    #[test]
    fn the_return_line_has_the_squared_multiplier() {
        let wheel = wheel(|_| ());
        let exact = wheel.fixed_point_rad_s(0.0).unwrap();
        let twice = |x: f64| {
            let once = wheel.mean_next_state(&[x].into(), &[0.0]).unwrap();
            wheel.mean_next_state(&[once[0]].into(), &[0.0]).unwrap()[0]
        };
        let pairs: Vec<_> = (-5..=5).map(|i| exact + 1e-4 * f64::from(i)).map(|x| (x, twice(x))).collect();
        let line = ReturnLine::fit(&pairs).unwrap();
        assert!((line.slope - 0.25).abs() < 1e-4);
        assert!((line.fixed_point().unwrap() - exact).abs() < 1e-7);
    }

    #[test]
    fn slow_wheels_stall_and_fast_ones_fly() {
        let wheel = wheel(|_| ());
        let no_return = |speed| match wheel.mean_next_state(&[speed].into(), &[0.0]) {
            Err(ProcessError::NoReturn { end }) => end,
            other => panic!("{other:?}"),
        };
        assert_eq!(no_return(0.3), StrideEnd::NoCrossing);
        assert_eq!(no_return(4.0), StrideEnd::Fell);
        let flat = RimlessWheel::new(RimlessWheelParameters { slope_rad: 0.0, ..Default::default() });
        assert!(flat.unwrap().fixed_point_rad_s(0.0).is_none());
        let bad = RimlessWheelParameters { half_angle_rad: f64::NAN, ..Default::default() };
        assert!(RimlessWheel::new(bad).unwrap_err().to_string().starts_with("half_angle_rad"));
    }

    #[test]
    fn a_rough_slope_ends_a_walk_sooner_or_later() {
        let mut wheel = wheel(|p| p.slope_std_rad = 0.04);
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        wheel.reset(&mut rng).unwrap();
        let walk = (0..10_000).find_map(|k| {
            let stride = wheel.stride(&[0.0], &mut rng).unwrap();
            (stride.end != StrideEnd::Crossing).then_some((k, stride.reward))
        });
        let (strides, reward) = walk.unwrap();
        assert!(strides > 3 && (reward + 1.0).abs() < 1e-15);
        assert!(matches!(wheel.stride(&[0.0], &mut rng), Err(ProcessError::NotReset)));
    }
}
