//! The way as a simulator knows it, beside the one that a robot estimates from its legs.

use stridemap_robot::RobotState;

/// Where a stride and its episode began, as a simulator knows it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TrueWay {
    first_heading_rad: Option<f64>,
    start_m: Option<[f64; 2]>,
}

impl TrueWay {
    /// An episode begins: its heading is the direction in which ways are measured.
    pub(crate) fn begin_episode(&mut self, truth: Option<&RobotState>) {
        self.first_heading_rad = truth.map(|t| t.base.heading_rad());
        self.begin_stride(truth);
    }

    /// A stride begins.
    pub(crate) fn begin_stride(&mut self, truth: Option<&RobotState>) {
        self.start_m = truth.map(|t| [t.com.position_m[0], t.com.position_m[1]]);
    }

    /// Way of the centre of mass since the stride began, along the episode's first heading.
    pub(crate) fn forward_m(&self, truth: &RobotState) -> Option<f64> {
        let (sin, cos) = self.first_heading_rad?.sin_cos();
        let [x, y] = self.start_m?;
        let [x_now, y_now, _] = truth.com.position_m;
        Some(cos * (x_now - x) + sin * (y_now - y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Facing +y at the start (a quarter turn about z), 3 m along x and 2 m along y are 2 m ahead.
    #[test]
    fn ways_are_along_the_first_heading() {
        let mut truth = RobotState::default();
        let half = std::f64::consts::FRAC_PI_4;
        truth.base.orientation = [half.cos(), 0.0, 0.0, half.sin()];
        let mut way = TrueWay::default();
        assert_eq!(way.forward_m(&truth), None);
        way.begin_episode(Some(&truth));
        truth.com.position_m = [3.0, 2.0, 0.0];
        truth.base.orientation = [1.0, 0.0, 0.0, 0.0];
        assert!((way.forward_m(&truth).unwrap() - 2.0).abs() < 1e-12);
        way.begin_stride(Some(&truth));
        assert!(way.forward_m(&truth).unwrap().abs() < 1e-12);
    }
}
