//! The bare physics, for the benchmark.

use std::time::Instant;

use stridemap_robot::{JointTargets, Robot};

use crate::robot::MujocoRobot;

impl MujocoRobot {
    /// Seconds that the `mj_step` calls of so many control periods take with nothing around them but the
    /// commands: the yardstick of [`Robot::step`]. Leaves [`Robot::state`] as it was, so reset afterwards.
    #[doc(hidden)]
    pub fn time_bare_steps(
        &mut self,
        periods: usize,
        mut targets: impl FnMut(f64) -> JointTargets,
    ) -> f64 {
        let period_s = self.description().control_period_s;
        let start = Instant::now();
        for period in 0..periods {
            #[expect(clippy::cast_precision_loss)] // Benchmarks are short.
            let time_s = period as f64 * period_s;
            self.command(&targets(time_s));
            for _ in 0..self.steps_per_period() {
                self.data.step();
            }
        }
        start.elapsed().as_secs_f64()
    }
}
