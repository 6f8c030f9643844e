//! How often bounds on falls hold what brute force says:
//! `cargo run --release --example time_to_fall -- --records 60 --seed S`.

use stridemap_stability::fall_study::{FallCoverage, SYSTEMS, fall_coverage};

#[allow(clippy::print_stdout, reason = "an example prints")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |name: &str, default: u64| -> Result<u64, std::num::ParseIntError> {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).map_or(Ok(default), |text| text.parse())
    };
    let (records, seed) = (number("--records", 60)?, number("--seed", 1)?);
    println!("{}", FallCoverage::HEADING);
    for system in &SYSTEMS {
        println!("{}", fall_coverage(system, records as usize, seed));
    }
    Ok(())
}
