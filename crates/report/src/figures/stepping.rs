//! Fig. 14: the roll of the pendulum at the section under an acquired stepping policy.

use super::check::{column, present, some};
use super::of_run::recorded;
use super::paper::PSI;
use crate::draw::{Axis, Dash, Key, Mark, N, Sheet, numbered};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::Run;

/// ψ_roll at sections 1, 2, ... after the start, degrees.
fn sections(run: &Run, what: &str) -> Vec<f64> {
    let crossed = recorded(run, what).into_iter().filter(|s| s.end == StrideEnd::Crossing);
    crossed.filter_map(|s| s.next_state.first().copied()).collect()
}

/// Draws Fig. 14: ψ_roll under the first iteration's policy solid, the desired angle dash-dotted, the nominal gait dotted.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if no section is left after the first ones, a value is not finite, or the task
/// desires no angle.
pub fn fig14(run: &Run) -> Result<Figure> {
    let stem = "fig14";
    let target = present(stem, "no desired angle in config.toml", run.target_deg())?;
    let (psi_deg, nominal) = (sections(run, "iteration-1"), sections(run, "nominal"));
    let discard = run.record_discard().unwrap_or(0);
    let n = psi_deg.len();
    some(stem, "sections to average", n.saturating_sub(discard))?;
    column(stem, "psi_roll_deg", &psi_deg, n)?;
    column(stem, "nominal_psi_roll_deg", &nominal, nominal.len())?;
    let mean = psi_deg[discard..].iter().sum::<f64>() / (n - discard) as f64;
    let longest = n.max(nominal.len());
    let values = psi_deg.iter().chain(&nominal).copied().chain([target]);
    let mut sheet = Sheet::new(stem, "Roll of the pendulum at the section");
    let x = Axis::counting("step", 0.0, longest as f64 + 0.5);
    let mut p = sheet.single(280.0, x, Axis::covering(&format!("{PSI} (deg)"), values), None);
    p.across(target, "s1", Dash::Chain);
    p.line(&numbered(&nominal), "ref", Dash::Dotted, 1.6);
    let acquired = numbered(&psi_deg);
    p.line(&acquired, "s0", Dash::Solid, 2.2);
    p.marks(&acquired, "s0", Mark::Disc, 3.2);
    let from = discard as f64 + 0.5;
    p.line(&[(from, mean), (n as f64 + 0.5, mean)], "s2", Dash::Dashed, 1.8);
    for (k, v) in &acquired {
        p.hover(*k, *v, format!("step {k}: {:.2} deg", N(*v)));
    }
    p.key("acquired policy", Key::Both("s0", Dash::Solid, Mark::Disc));
    p.key("desired angle", Key::Line("s1", Dash::Chain));
    p.key("mean", Key::Line("s2", Dash::Dashed));
    if !nominal.is_empty() {
        p.key("nominal gait", Key::Line("ref", Dash::Dotted));
    }
    sheet.add(p);
    let (strides, first, [desired, mean]) = (run.map_strides(1).count(), discard + 1, [target, mean].map(N));
    let caption = format!(
        "Fig. 14 of the paper. Roll of the pendulum at the section over {n} steps of the small humanoid under the policy learned from \
         {strides} strides (solid), as the robot estimates it, and the desired angle of {desired:.1} deg (dash-dotted). Mean over \
         steps {first} to {n}: {mean:.2} deg (paper: 0.12 deg over steps 10 to 40)."
    );
    let mut csv = String::from("step,psi_roll_deg,nominal_psi_roll_deg,target_deg\n");
    for i in 0..longest {
        let cell = |values: &[f64]| values.get(i).map_or_else(String::new, ToString::to_string);
        csv += &format!("{},{},{},{target}\n", i + 1, cell(&psi_deg), cell(&nominal));
    }
    let alt = format!(
        "Line plot of psi_roll at the section over {n} steps: after the start it stays near {mean:.2} deg, the target being \
         {desired:.1} deg."
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_record::Transition;

    #[test]
    fn the_mean_leaves_the_first_steps_out_and_the_table_has_every_step() {
        let stride = |what: &str, psi: f64| {
            (what.to_owned(), Transition { next_state: [psi].as_slice().into(), ..Default::default() })
        };
        let psi = [5.0; 10].into_iter().chain([0.1, 0.3].repeat(15)).map(|psi| stride("iteration-1", psi));
        let config = |discard: usize| {
            Some(format!(
                "[record]\ndiscard = {discard}\n[[reward]]\nquantity = \"psi_roll_squared_error\"\ntarget_deg = 0.0\n"
            ))
        };
        let record = psi.chain((0..40).map(|_| stride("nominal", 6.0))).collect();
        let run = Run { record, config: config(10), ..Run::default() };
        let figure = fig14(&run).unwrap();
        assert!(figure.caption.contains("Mean over steps 11 to 40: 0.20 deg"), "{}", figure.caption);
        assert_eq!(figure.csv.lines().count(), 41);
        assert!(figure.csv.contains("\n11,0.1,6,0\n"));
        assert!(fig14(&Run { config: config(40), ..run }).is_err());
    }
}
