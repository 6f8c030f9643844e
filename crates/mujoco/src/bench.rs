//! The bare physics, for the benchmark.

use std::time::Instant;

use stridemap_robot::JointTargets;

use crate::robot::MujocoRobot;

impl MujocoRobot {
    /// Seconds that the `mj_step` calls of these control periods take with nothing around them but the
    /// commands: the yardstick of a step. Leaves the state as it was, so reset afterwards.
    #[doc(hidden)]
    pub fn time_bare_steps(&mut self, commands: &[JointTargets]) -> f64 {
        let start = Instant::now();
        for targets in commands {
            self.command(targets);
            for _ in 0..self.steps_per_period() {
                self.data.step();
            }
        }
        start.elapsed().as_secs_f64()
    }
}
