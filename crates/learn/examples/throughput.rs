//! What a stride costs the learner itself: the actor-critic on a map that costs next to nothing.
//!
//! ```text
//! cargo run --release -p stridemap-learn --example throughput
//! ```
#![allow(clippy::print_stdout)]

use std::time::Instant;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{ActorCritic, ActorCriticConfig, Learner};
use stridemap_process::{Action, Next, walk};
use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut map = LinearGaussianMap::new(LinearGaussianParameters::stepping())?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);

    // The map and the restarts alone, to be taken off.
    let strides = 2_000_000;
    let start = Instant::now();
    let mut sum = 0.0;
    let one = Action::from_slice(&[1.0]);
    walk(
        &mut map,
        strides,
        &mut rng,
        |_| one.clone(),
        |_, made| {
            sum += made.stride.reward;
            if made.k == 5 { Next::Restart } else { Next::Go }
        },
    )?;
    let map_ns = start.elapsed().as_secs_f64() / strides as f64 * 1e9;

    let config = ActorCriticConfig { trials: 50_000, ..ActorCriticConfig::stepping() };
    let start = Instant::now();
    let outcome = ActorCritic { config }.improve(&mut map, None, &mut rng, &mut |_| ())?;
    let total_ns = start.elapsed().as_secs_f64() / outcome.strides as f64 * 1e9;
    let bases = outcome.trials.last().map_or(0, |t| t.bases);

    let start = Instant::now();
    let runs = 50;
    for _ in 0..runs {
        ActorCritic { config: ActorCriticConfig::stepping() }.improve(&mut map, None, &mut rng, &mut |_| ())?;
    }
    let improve_ms = start.elapsed().as_secs_f64() / f64::from(runs) * 1e3;

    println!("map and restarts alone   {map_ns:7.0} ns a stride (check {:.3})", sum.signum());
    println!("actor-critic and map     {total_ns:7.0} ns a stride, {bases} bases");
    println!("the learner itself       {:7.0} ns a stride", total_ns - map_ns);
    println!("one improvement          {improve_ms:7.2} ms (200 trials of 24 strides)");
    Ok(())
}
