//! `bench coverage` and `bench time-to-fall`: do the intervals of `analyse` hold the truth?

use stridemap_stability::coverage::{Case, Coverage, coverage};
use stridemap_stability::fall_study::{FallCoverage, SYSTEMS, fall_coverage};

use crate::failure::Failure;
use crate::output;

/// Multipliers of random linear systems.
pub fn multipliers(systems: usize, seed: u64, json: bool) -> Result<(), Failure> {
    let mut found = Vec::new();
    if !json {
        output::line(format!("share of 95 % intervals that hold the truth, %\n{}", Coverage::HEADING));
    }
    for case in Case::ALL {
        let row = coverage(case, systems, seed)?;
        if !json {
            output::line(row.to_string());
        }
        found.push(row);
    }
    if json { output::json(&found) } else { Ok(()) }
}

/// Time to fall of systems whose falls can be counted.
pub fn time_to_fall(records: usize, seed: u64, json: bool) -> Result<(), Failure> {
    let mut found = Vec::new();
    if !json {
        output::line(FallCoverage::HEADING);
    }
    for system in &SYSTEMS {
        let row = fall_coverage(system, records, seed);
        if !json {
            output::line(row.to_string());
        }
        found.push(row);
    }
    if json { output::json(&found) } else { Ok(()) }
}
