//! `push.csv` and `push.json`: the return map under pushes.

use serde::{Deserialize, Serialize};

use crate::error::RecordError;
use crate::return_line::ReturnMapLine;
use crate::stride::Fall;
use crate::table::Table;

/// One pair of the return map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PushPair {
    /// Stride of the push.
    pub k: usize,
    /// `ψ_roll` at the first section after the push.
    pub psi_roll_deg: f64,
    /// `ψ_roll` one stride later; NaN in tables of earlier versions.
    pub psi_roll_after_1_deg: f64,
    /// `ψ_roll` two strides later.
    pub psi_roll_after_2_deg: f64,
    /// The force, + to the robot's left.
    pub force_n: f64,
}

/// What pushes showed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PushOutcome {
    /// Slope of the line through the pairs; null with fewer than three pairs.
    pub slope: Option<f64>,
    /// Standard error of the slope.
    pub slope_std_error: Option<f64>,
    /// Where the line meets the diagonal: intercept / (1 − slope).
    pub fixed_point_deg: Option<f64>,
    /// The return map ψ(k) → ψ(k+1) of the same pushes; null with fewer than three pairs.
    #[serde(default)]
    pub after_1: Option<ReturnMapLine>,
    /// Falls, all of them; pairs with a fall in them are left out.
    pub falls: usize,
    /// The causes of falls and stalls, those of starts as well.
    #[serde(default)]
    pub causes: Vec<Fall>,
    /// Pairs behind the line.
    pub pairs: usize,
    /// Strides made.
    pub strides: usize,
    /// The largest force.
    pub force_n: f64,
    /// How long each push acted.
    pub duration_s: f64,
    /// The largest impulse: force times duration.
    #[serde(default)]
    pub impulse_n_s: f64,
    /// The change of velocity that it gives the whole robot.
    #[serde(default)]
    pub velocity_change_m_s: f64,
    /// The pairs.
    #[serde(skip)]
    pub data: Vec<PushPair>,
}

impl PushOutcome {
    /// The pairs as CSV.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from("k,psi_roll_deg,psi_roll_after_1_deg,psi_roll_after_2_deg,force_n\n");
        for p in &self.data {
            text += &format!(
                "{},{},{},{},{}\n",
                p.k, p.psi_roll_deg, p.psi_roll_after_1_deg, p.psi_roll_after_2_deg, p.force_n
            );
        }
        text
    }
}

/// The pairs of a table. Those of an earlier version do not know the section between.
pub(crate) fn pairs(table: &Table) -> Result<Vec<PushPair>, RecordError> {
    let pairs = table.rows().map(|row| {
        let row = row?;
        let after_1 = "psi_roll_after_1_deg";
        Ok(PushPair {
            k: row.count("k")?,
            psi_roll_deg: row.number("psi_roll_deg")?,
            psi_roll_after_1_deg: if table.has(after_1) { row.number(after_1)? } else { f64::NAN },
            psi_roll_after_2_deg: row.number("psi_roll_after_2_deg")?,
            force_n: row.number("force_n")?,
        })
    });
    pairs.collect()
}
