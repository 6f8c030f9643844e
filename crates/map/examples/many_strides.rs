//! A sparse map of 50,000 strides of the compass gait: how long it takes, and how good it is.
//!
//! ```text
//! cargo run --release -p stridemap-map --example many_strides
//! ```
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::time::Instant;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_gp::{Kernel, Mean, RegressorKind};
use stridemap_map::{LearnedMap, MapConfig, MapDraw, MapFailure, MapInput, MapSample, MapStart, MapWorld};
use stridemap_process::{
    Action, ActionLimits, Actor, Made, MeanMap, Next, ProcessError, Situation, StrideEnd, StrideProcess, roll_out, walk,
};
use stridemap_testbed::{CompassGait, CompassGaitParameters};

const STRIDES: usize = 50_000;

/// A torque at random in every stride, ten strides an episode.
struct Explorer(Vec<MapSample>);

impl Actor<CompassGait, ProcessError> for Explorer {
    fn act(&mut self, _: &mut CompassGait, _: &Situation, rng: &mut ChaCha8Rng) -> Result<Action, ProcessError> {
        Ok(Action::from_slice(&[rng.random::<f64>() - 0.5]))
    }
    fn saw(&mut self, _: &mut CompassGait, made: Made<'_>) -> Result<Next, ProcessError> {
        if made.stride.end == StrideEnd::Crossing {
            let (action, next_state) = (made.stride.action().clone(), made.stride.next.state.clone());
            self.0.push(MapSample { at: made.at.clone(), action, next_state, reward: made.stride.reward });
        }
        Ok(if made.k == 9 { Next::Restart } else { Next::Go })
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut gait = CompassGait::new(CompassGaitParameters { initial_std: 0.02, ..Default::default() })?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut explorer = Explorer(Vec::new());
    roll_out(&mut gait, STRIDES + 5_000, &mut explorer, &mut rng)?;
    let (seen, unseen) = explorer.0.split_at(STRIDES.min(explorer.0.len() - 500));

    let config = MapConfig {
        inputs: vec![MapInput::State, MapInput::Action],
        invariant: Vec::new(),
        remembered: None,
        regressor: RegressorKind::Sparse,
        kernel: Kernel::SquaredExponential,
        mean: Mean::Linear,
        starts: 1,
        min_length_scales: None,
        min_noise_std: None,
        draw: MapDraw::Full,
        state_range: vec![[-10.0, 10.0]; 3],
        start: MapStart::Data,
        start_range: vec![[-1.0, 1.0]; 3],
        prior: None,
    };
    let bounds = &gait.spec().action[0];
    let (lower, upper) = (bounds.lower, bounds.upper);
    let world = MapWorld {
        spec: gait.spec().clone(),
        limits: vec![ActionLimits { lower, upper, rate_per_stride: f64::INFINITY, gain: 1.0, neutral: 0.0 }],
        failure: MapFailure { component: None, below: 0.0, reward: -1.0 },
        reward: Some(std::sync::Arc::new(|_: &[f64]| 0.0)),
    };
    let started = Instant::now();
    let mut map = LearnedMap::fit(config, world, seen, &mut rng)?;
    println!("{} strides, 3 outputs: fitted in {:.1} s", seen.len(), started.elapsed().as_secs_f64());

    for (i, output) in map.outputs().iter().enumerate() {
        let off = unseen.iter().map(|s| Ok((map.mean_next_state(&s.at, &s.action)?[i] - s.next_state[i]).powi(2)));
        let square: f64 = off.sum::<Result<f64, ProcessError>>()? / unseen.len() as f64;
        let spread = stridemap_gp::spread(&unseen.iter().map(|s| s.next_state[i]).collect::<Vec<_>>());
        let scores = output.leave_one_out()?.scores();
        println!(
            "x{i}: error on {} unseen strides {:.4} of their spread, leaving one out {:.4}; 90 % intervals hold {:.1} %",
            unseen.len(),
            square.sqrt() / spread,
            scores.rmse / spread,
            100.0 * scores.coverage_90
        );
    }
    let (imagined, still) = (200_000, Action::from_slice(&[0.0]));
    let started = Instant::now();
    walk(&mut map, imagined, &mut rng, |_| still.clone(), |_, _| Next::Go)?;
    println!("{:.0} imagined strides a second", imagined as f64 / started.elapsed().as_secs_f64());
    Ok(())
}
