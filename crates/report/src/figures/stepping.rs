//! Fig. 14: the roll of the pendulum at the section under an acquired stepping policy.

use super::check::{column, some};
use super::paper::PSI;
use crate::draw::{Axis, Dash, Key, Mark, Sheet, signed};
use crate::error::Result;
use crate::figure::Figure;

/// ψ_roll at the sections of a measured policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig14 {
    /// ψ_roll at sections 1, 2, ... after the start, degrees.
    pub psi_roll_deg: Vec<f64>,
    /// The same of the nominal gait; may be empty.
    pub nominal_psi_roll_deg: Vec<f64>,
    /// What the policy is to reach, degrees.
    pub target_deg: f64,
    /// First sections that are left out of the mean.
    pub discard: usize,
    /// Strides from which the policy was learned.
    pub samples: usize,
}

impl Fig14 {
    /// Mean after the first sections, degrees; `None` if none is left.
    ///
    /// # Example
    ///
    /// ```
    /// let data = stridemap_report::figures::Fig14 {
    ///     psi_roll_deg: vec![9.0, 1.0, 2.0],
    ///     nominal_psi_roll_deg: vec![],
    ///     target_deg: 0.0,
    ///     discard: 1,
    ///     samples: 20,
    /// };
    /// assert_eq!(data.mean_deg(), Some(1.5));
    /// ```
    #[must_use]
    pub fn mean_deg(&self) -> Option<f64> {
        let kept = self.psi_roll_deg.get(self.discard..)?;
        (!kept.is_empty()).then(|| kept.iter().sum::<f64>() / kept.len() as f64)
    }
}

/// Draws Fig. 14: ψ_roll solid, the desired angle dash-dotted, the nominal gait dotted.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if no section is left after the first ones, or a value is not finite.
pub fn fig14(data: &Fig14) -> Result<Figure> {
    let stem = "fig14";
    let n = data.psi_roll_deg.len();
    some(stem, "sections to average", n.saturating_sub(data.discard))?;
    column(stem, "psi_roll_deg", &data.psi_roll_deg, n)?;
    let nominal = &data.nominal_psi_roll_deg;
    column(stem, "nominal_psi_roll_deg", nominal, nominal.len())?;
    let mean = data.mean_deg().unwrap_or(f64::NAN);
    let values = data.psi_roll_deg.iter().chain(nominal).copied();
    let mut sheet = Sheet::new(stem, "Roll of the pendulum at the section");
    let mut p = sheet.single(
        280.0,
        Axis::counting("step", 0.0, n.max(nominal.len()) as f64 + 0.5),
        Axis::covering(&format!("{PSI} (deg)"), values.chain([data.target_deg])),
    );
    let points =
        |values: &[f64]| -> Vec<(f64, f64)> { values.iter().enumerate().map(|(i, v)| (i as f64 + 1.0, *v)).collect() };
    p.across(data.target_deg, "s1", Dash::Chain);
    p.line(&points(nominal), "ref", Dash::Dotted, 1.6);
    let acquired = points(&data.psi_roll_deg);
    p.line(&acquired, "s0", Dash::Solid, 2.2);
    p.marks(&acquired, "s0", Mark::Disc, 3.2);
    let from = data.discard as f64 + 0.5;
    p.line(&[(from, mean), (n as f64 + 0.5, mean)], "s2", Dash::Dashed, 1.8);
    for (k, v) in &acquired {
        p.hover(*k, *v, format!("step {k}: {} deg", signed(*v, 2)));
    }
    p.key("acquired policy", Key::Both("s0", Dash::Solid, Mark::Disc));
    p.key("desired angle", Key::Line("s1", Dash::Chain));
    p.key("mean", Key::Line("s2", Dash::Dashed));
    if !nominal.is_empty() {
        p.key("nominal gait", Key::Line("ref", Dash::Dotted));
    }
    sheet.add(p);
    let caption = format!(
        "Fig. 14 of the paper. Roll of the pendulum at the section over {n} steps of the small humanoid under the policy learned from \
         {} strides (solid), as the robot estimates it, and the desired angle of {} deg (dash-dotted). Mean over steps {} to {n}: \
         {} deg (paper: 0.12 deg over steps 10 to 40).",
        data.samples,
        signed(data.target_deg, 1),
        data.discard + 1,
        signed(mean, 2),
    );
    let mut csv = String::from("step,psi_roll_deg,nominal_psi_roll_deg,target_deg\n");
    for i in 0..n.max(nominal.len()) {
        let cell = |values: &[f64]| values.get(i).map_or_else(String::new, ToString::to_string);
        csv.push_str(&format!("{},{},{},{}\n", i + 1, cell(&data.psi_roll_deg), cell(nominal), data.target_deg));
    }
    let alt = format!(
        "Line plot of psi_roll at the section over {n} steps: after the start it stays near {} deg, the target being {} deg.",
        signed(mean, 2),
        signed(data.target_deg, 1)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_leaves_the_first_steps_out_and_the_table_has_every_step() {
        let mut psi = vec![5.0; 10];
        psi.extend([0.1, 0.3].repeat(15));
        let data =
            Fig14 { psi_roll_deg: psi, nominal_psi_roll_deg: vec![6.0; 40], target_deg: 0.0, discard: 10, samples: 20 };
        let figure = fig14(&data).unwrap();
        assert!(figure.caption.contains("Mean over steps 11 to 40: 0.20 deg"), "{}", figure.caption);
        assert_eq!(figure.csv.lines().count(), 41);
        assert!(figure.csv.contains("\n11,0.1,6,0\n"));
        assert!(fig14(&Fig14 { discard: 40, ..data }).is_err());
    }
}
