//! `bench`: where the time goes, as ratios measured in one run.

use std::time::Instant;

use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Algorithm, LabError, NoRecorder, Plant, builtin};
use stridemap_learn::Policy;
use stridemap_process::{Action, Actor, Made, Next, ProcessError, Situation, roll_out, walk};

use crate::failure::Failure;
use crate::output;

/// Strides on the robot that are timed.
const PLANT_STRIDES: usize = 200;
/// Imagined strides that are timed.
const MAP_STRIDES: usize = 200_000;

#[derive(Serialize)]
struct Timings {
    /// A stride on the robot over the bare physics steps in it.
    plant_over_physics: f64,
    plant_stride_ms: f64,
    physics_step_us: f64,
    imagined_strides_per_s: f64,
    imagined_over_real_time: f64,
    learn_simulation_s: f64,
    learn_fit_s: f64,
    learn_improve_s: f64,
    learn_total_s: f64,
    fit_and_improve_over_simulation: f64,
}

/// Walks one action, timed from the end of the start-up on.
struct Timed {
    action: Action,
    started: Instant,
    engine_s: Option<f64>,
    robot_s: f64,
}

impl Actor<Plant, ProcessError> for Timed {
    fn begin(&mut self, plant: &mut Plant, _: &Situation) -> Result<Next, ProcessError> {
        (self.engine_s, self.robot_s) = (plant.robot().engine_seconds(), plant.robot().state().time_s);
        self.started = Instant::now();
        Ok(Next::Go)
    }
    fn act(&mut self, _: &mut Plant, _: &Situation, _: &mut ChaCha8Rng) -> Result<Action, ProcessError> {
        Ok(self.action.clone())
    }
    fn saw(&mut self, _: &mut Plant, _: Made<'_>) -> Result<Next, ProcessError> {
        Ok(Next::Go)
    }
}

/// Times the parts of `learn stepping`.
pub fn bench(json: bool) -> Result<(), Failure> {
    let task = builtin::load("stepping", &[])?.task;

    output::note("strides on the robot against the physics in them");
    let mut plant = task.plant()?;
    let mut rng = stream(1, Role::Run, 0);
    let action = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let mut timed = Timed { action, started: Instant::now(), engine_s: None, robot_s: 0.0 };
    roll_out(&mut plant, PLANT_STRIDES, &mut timed, &mut rng).map_err(LabError::from)?;
    let plant_s = timed.started.elapsed().as_secs_f64();
    let engine_s = match (timed.engine_s, plant.robot().engine_seconds()) {
        (Some(before), Some(after)) => after - before,
        _ => f64::NAN,
    };
    let robot_s = plant.robot().state().time_s - timed.robot_s;
    let step_s = task.robot.time_step_s.unwrap_or(0.001);

    output::note("a whole run of learn stepping");
    let mut algorithm = Algorithm::new(&task, 1)?;
    algorithm.learn(&mut NoRecorder)?;
    let seconds = algorithm.progress.seconds;
    let total_s = algorithm.progress.total_seconds;

    output::note("strides in its map");
    let mut map = algorithm.fit(&mut NoRecorder)?;
    let policy = task.nominal_policy()?;
    let started = Instant::now();
    let mean = |at: &Situation| policy.mean(at);
    walk(&mut map, MAP_STRIDES, &mut rng, mean, |_, _| Next::Go).map_err(LabError::from)?;
    let per_s = MAP_STRIDES as f64 / started.elapsed().as_secs_f64();

    let timings = Timings {
        plant_over_physics: plant_s / engine_s,
        plant_stride_ms: 1e3 * plant_s / PLANT_STRIDES as f64,
        physics_step_us: 1e6 * engine_s / (robot_s / step_s),
        imagined_strides_per_s: per_s,
        imagined_over_real_time: per_s * robot_s / PLANT_STRIDES as f64,
        learn_simulation_s: seconds.simulation,
        learn_fit_s: seconds.fit,
        learn_improve_s: seconds.improve,
        learn_total_s: total_s,
        fit_and_improve_over_simulation: (seconds.fit + seconds.improve) / seconds.simulation,
    };
    if json {
        return output::json(&timings);
    }
    let t = &timings;
    output::line(format!(
        "a stride on the robot: {:.2} ms, {:.2} times the bare physics in it ({:.2} us a step)",
        t.plant_stride_ms, t.plant_over_physics, t.physics_step_us
    ));
    output::line(format!(
        "imagined strides: {:.0} a second, {:.0} times faster than the robot walks",
        t.imagined_strides_per_s, t.imagined_over_real_time
    ));
    output::line(format!(
        "learn stepping: {:.2} s: robot {:.2}, fit {:.3}, improve {:.3}; fit and improve are {:.1} % of \
         the robot's",
        t.learn_total_s,
        t.learn_simulation_s,
        t.learn_fit_s,
        t.learn_improve_s,
        100.0 * t.fit_and_improve_over_simulation
    ));
    Ok(())
}
