//! Walks a task's robot with its one action held, several individuals for each value: what is there to
//! be gained, and what limits it?
//!
//! ```sh
//! cargo run --example held_actions -- small-walking 101 4 9 10 11 12   # first seed, seeds, values
//! ```

#![allow(clippy::print_stdout, reason = "a table is what it is for")]

use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Batch, Walker, builtin, drive};
use stridemap_learn::ConstantPolicy;
use stridemap_process::StrideEnd;
use stridemap_record::{StridePhase, StrideRole, Transition, Walk, WalkTimes};

/// How long each walks, and over which part the speed is taken.
const TIMES: WalkTimes = WalkTimes { walk_s: 60.0, speed_s: 30.0 };

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [task, first, seeds, values @ ..] = words.as_slice() else {
        return Err("needs a task, the first seed, the number of seeds, and values".into());
    };
    let (first, seeds): (u64, u64) = (first.parse()?, seeds.parse()?);
    for value in values {
        let action: f64 = value.parse()?;
        for seed in first..first + seeds {
            let bounds = format!("action.0.bounds=[{}, {}]", action.min(0.0), action.max(0.0));
            let task = builtin::load(task, &[bounds])?.on(None, seed)?.task;
            let mut plant = task.plant()?;
            let policy = ConstantPolicy::new(task.process_spec()?, &[action])?;
            let strides = drive(
                &mut plant,
                &mut Walker::new(&policy, TIMES.walk_s),
                Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: usize::MAX },
                &mut stream(seed, Role::Record, 7),
                &mut |_, _| {},
                &mut |_| Ok(()),
            )?;
            let walk = Walk::of(&strides, TIMES);
            let turn = |w: &[Transition]| w[0].measures.turn_deg + w[1].measures.turn_deg;
            let turns = strides.windows(2).map(|w| turn(w).abs());
            let upright = strides.iter().filter(|t| t.end == StrideEnd::Crossing);
            let psi: Vec<f64> = upright.map(|t| t.measures.psi_roll_deg).collect();
            println!(
                "{action:>5} seed {seed}: {:.4} m/s (true {:.4}), upright {:.0} s, heading {:+.0} deg, turn of two \
                 strides up to {:.1} deg, psi_roll {:.2} deg (in place {:.2}), {:.3} s a stride",
                walk.speed_m_s,
                walk.true_speed_m_s.unwrap_or(walk.speed_m_s),
                walk.upright_s,
                walk.heading_change_deg,
                turns.fold(0.0, f64::max),
                psi.iter().sum::<f64>() / psi.len().max(1) as f64,
                plant.in_place().psi_roll_deg,
                walk.upright_s / strides.len().max(1) as f64,
            );
        }
    }
    Ok(())
}
