//! Do two halves of a record agree, with the intervals that `analyse` prints? No truth is needed for that.
//! `cargo run --release --example halves -- FILE...`, each with the numbers of a stride in a row; the last is looked at.

use stridemap_stability::{Analysis, Bout, Estimate, Method, Options, Record, StabilityError, analyse};

/// The record of a file: its last column.
fn read(path: &str) -> Result<Record, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut states = Vec::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let last = line.split_whitespace().last().ok_or("an empty line")?;
        states.push(vec![last.parse::<f64>().map_err(|e| format!("{path}: {last:?}: {e}"))?]);
    }
    let bouts = vec![Bout { states, ..Bout::default() }];
    Ok(Record { state: vec!["interval_s".into()], bouts, stride_s: None })
}

/// Whether the 95 % interval of the difference of two independent estimates holds zero.
fn agree(a: Estimate, b: Estimate) -> bool {
    let (above, below) = if a.value > b.value { (a, b) } else { (b, a) };
    let reach = (above.value - above.low).hypot(below.high - below.value);
    above.value - below.value <= reach
}

/// What the checks said, in letters.
fn fired(a: &Analysis) -> String {
    let c = &a.checks;
    let checks = [
        (c.excited.pass, "memory"),
        (c.white_residuals.pass, "white"),
        (c.steady_mean.pass, "mean"),
        (c.unstable.pass, "growing"),
        (c.long_enough.pass, "length"),
    ];
    let names: Vec<&str> = checks.iter().filter(|(pass, _)| !pass).map(|(_, name)| *name).collect();
    if names.is_empty() { "none".into() } else { names.join("+") }
}

fn said(a: &Analysis) -> String {
    a.multipliers.as_ref().map_or("refused              ".into(), |m| {
        let Estimate { value, low, high } = m.largest;
        let from = if m.method == Method::Pieces { "pieces" } else { "whole " };
        format!("{value:.2} ({low:.2} to {high:.2}) {from}")
    })
}

#[allow(clippy::print_stdout, reason = "an example prints")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let (mut both, mut agreeing) = (0, 0);
    println!("record, halves: largest multiplier (95 % interval); checks that fired in each");
    for file in &files {
        let record = read(file)?;
        let n = record.strides();
        let half =
            |from, to| -> Result<Analysis, StabilityError> { analyse(&record.between(from, to), &Options::default()) };
        let (first, second) = (half(0, n / 2)?, half(n / 2, n)?);
        let name = file.rsplit('/').next().unwrap_or(file);
        let verdict = match (&first.multipliers, &second.multipliers) {
            (Some(a), Some(b)) => {
                let same = agree(a.largest, b.largest);
                (both, agreeing) = (both + 1, agreeing + usize::from(same));
                if same { "agree" } else { "DIFFER" }
            }
            _ => "not compared",
        };
        println!(
            "{name:<11} {} | {} | {} | {} | {verdict}",
            said(&first),
            said(&second),
            fired(&first),
            fired(&second)
        );
    }
    println!("{agreeing} of {both} agree; {} of {} records were refused in a half", files.len() - both, files.len());
    Ok(())
}
