//! How often intervals of level 95 % hold the truth, on random linear systems:
//! `cargo run --release --example coverage -- --systems 800 --seed S`.

use cpu_time::ProcessTime;

use stridemap_stability::coverage::{Case, Coverage, coverage, record_to_time};
use stridemap_stability::{Options, SensorKnowledge, analyse};

#[allow(clippy::print_stdout, reason = "an example prints")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |name: &str, default: u64| -> Result<u64, std::num::ParseIntError> {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).map_or(Ok(default), |text| text.parse())
    };
    let (systems, seed) = (number("--systems", 800)?, number("--seed", 1)?);
    println!("share of 95 % intervals that hold the truth, %\n{}", Coverage::HEADING);
    for case in Case::ALL {
        println!("{}", coverage(case, systems as usize, seed)?);
    }
    for (d, strides) in [(1, 50), (3, 200)] {
        for (case, sensor) in [(Case::NoNoise, SensorKnowledge::Exact), (Case::Unknown, SensorKnowledge::Estimated)] {
            let records = (0..20).map(|i| record_to_time(d, strides, case, i)).collect::<Result<Vec<_>, _>>()?;
            let options = Options { sensor, ..Options::default() };
            let start = ProcessTime::now();
            for record in &records {
                analyse(record, &options)?;
            }
            let each_ms = start.elapsed().as_secs_f64() * 1e3 / records.len() as f64;
            println!(
                "{d} component(s), {strides} strides, sensor {case:?}: {each_ms:.2} ms of processor time a record"
            );
        }
    }
    Ok(())
}
