//! `push-atlas.csv` and `push-atlas.json`: the largest push that is survived, by phase of the gait and direction.

use serde::{Deserialize, Serialize};

use crate::error::RecordError;
use crate::stride::FallCriterion;
use crate::table::Table;

/// The largest push that is survived at one phase, in one direction, of one duration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtlasCell {
    /// For how long the force acts.
    pub duration_s: f64,
    /// When it begins: share of a stride after the section, in [0, 1).
    pub phase: f64,
    /// Where it points: 0 forward, 90 to the side of the stance leg, 180 back, 270 to the side of the swing leg.
    pub direction_deg: f64,
    /// The largest change of velocity that was tried and survived; 0 where none was.
    pub survived_m_s: f64,
    /// The smallest that was tried above it, and made the robot fall; `None` where the largest of all was survived.
    pub fallen_m_s: Option<f64>,
    /// Strides after the largest that is survived until the state is back; `None` if it was not within those watched.
    pub strides_to_recover: Option<usize>,
    /// By what the smallest that is not survived was a fall.
    pub fall_criterion: Option<FallCriterion>,
    /// Pushes tried.
    pub trials: usize,
    /// Strides made for them.
    pub strides: usize,
}

/// What holds for all pushes of one duration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtlasHeadline {
    /// For how long the force acts.
    pub duration_s: f64,
    /// The smallest over phases and directions of the largest push that is survived.
    pub smallest_m_s: f64,
    /// The smallest push there that makes the robot fall; `None` if none does.
    pub smallest_fallen_m_s: Option<f64>,
    /// At which phase.
    pub smallest_phase: f64,
    /// In which direction.
    pub smallest_direction_deg: f64,
    /// Its impulse.
    pub smallest_n_s: f64,
    /// Its force.
    pub smallest_n: f64,
    /// Its force over the robot's weight.
    pub smallest_of_weight: f64,
    /// The median over phases and directions.
    pub median_m_s: f64,
    /// Share of phase x direction x size that is survived, up to the largest size tried.
    pub area_survived: f64,
    /// The median number of strides to recover from the largest push survived, where the robot did.
    pub median_strides_to_recover: Option<f64>,
}

/// A push atlas: everything but its cells is in the JSON file, the cells are in the table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PushAtlas {
    /// Version of the file.
    pub format: u32,
    /// `learned` or `nominal`.
    pub policy: String,
    /// Root of every random stream.
    pub seed: u64,
    /// Hash of what it was made of: version, task, policy, setting and seed.
    pub made_of: String,
    /// The body that is pushed; empty: the torso.
    pub body: String,
    /// Of the whole robot: force = mass x change of velocity / duration.
    pub mass_kg: f64,
    /// The largest change of velocity tried.
    pub largest_m_s: f64,
    /// The bisection ends when survived and fallen are this near.
    pub tolerance_m_s: f64,
    /// Strides before the push.
    pub settle_strides: usize,
    /// Strides after the pushed one without a fall that make a push survived.
    pub after_strides: usize,
    /// Mean duration of a stride without pushes.
    pub stride_s: f64,
    /// Pushes tried.
    pub trials: usize,
    /// Strides made.
    pub strides: usize,
    /// What holds for each duration.
    pub durations: Vec<AtlasHeadline>,
    /// The cells, by duration, phase and direction.
    #[serde(skip)]
    pub cells: Vec<AtlasCell>,
}

/// Gravity, for forces in weights.
const GRAVITY_M_S2: f64 = 9.81;

/// The middle of some values.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

impl PushAtlas {
    /// Takes the cells, and says what holds for each duration.
    ///
    /// # Example
    ///
    /// Two cells of a robot of 10 kg, pushed for 0.2 s: the weaker survives 0.1 m/s, that is 1 N s in 0.2 s, 5 N:
    ///
    /// ```
    /// use stridemap_record::{AtlasCell, PushAtlas};
    ///
    /// let cell = |phase, survived_m_s| AtlasCell {
    ///     duration_s: 0.2, phase, direction_deg: 90.0, survived_m_s, fallen_m_s: Some(survived_m_s + 0.01),
    ///     strides_to_recover: Some(3), fall_criterion: None, trials: 8, strides: 100,
    /// };
    /// let empty = PushAtlas { mass_kg: 10.0, largest_m_s: 1.2, ..PushAtlas::default() };
    /// let atlas = empty.with(vec![cell(0.0, 0.3), cell(0.5, 0.1)]);
    /// let of = &atlas.durations[0];
    /// assert_eq!((of.smallest_m_s, of.smallest_phase, of.median_m_s), (0.1, 0.5, 0.2));
    /// assert!((of.smallest_n - 5.0).abs() < 1e-12 && (of.smallest_of_weight - 5.0 / 98.1).abs() < 1e-12);
    /// assert!((of.area_survived - 0.2 / 1.2).abs() < 1e-12);
    /// assert_eq!(atlas.trials, 16);
    /// ```
    #[must_use]
    pub fn with(mut self, cells: Vec<AtlasCell>) -> Self {
        let mut durations_s: Vec<f64> = cells.iter().map(|c| c.duration_s).collect();
        durations_s.dedup();
        self.durations = durations_s.into_iter().filter_map(|duration_s| self.headline(&cells, duration_s)).collect();
        self.trials = cells.iter().map(|c| c.trials).sum();
        self.strides = cells.iter().map(|c| c.strides).sum();
        self.cells = cells;
        self
    }

    fn headline(&self, cells: &[AtlasCell], duration_s: f64) -> Option<AtlasHeadline> {
        let of: Vec<&AtlasCell> = cells.iter().filter(|c| c.duration_s.total_cmp(&duration_s).is_eq()).collect();
        let weakest = of.iter().min_by(|a, b| a.survived_m_s.total_cmp(&b.survived_m_s))?;
        let smallest_n_s = self.mass_kg * weakest.survived_m_s;
        let mean = of.iter().map(|c| c.survived_m_s).sum::<f64>() / of.len() as f64;
        let recovered = of.iter().filter_map(|c| c.strides_to_recover).map(|n| n as f64);
        Some(AtlasHeadline {
            duration_s,
            smallest_m_s: weakest.survived_m_s,
            smallest_fallen_m_s: weakest.fallen_m_s,
            smallest_phase: weakest.phase,
            smallest_direction_deg: weakest.direction_deg,
            smallest_n_s,
            smallest_n: smallest_n_s / duration_s,
            smallest_of_weight: smallest_n_s / duration_s / (self.mass_kg * GRAVITY_M_S2),
            median_m_s: median(of.iter().map(|c| c.survived_m_s).collect())?,
            area_survived: mean / self.largest_m_s,
            median_strides_to_recover: median(recovered.collect()),
        })
    }

    /// The weakest of all durations.
    #[must_use]
    pub fn weakest(&self) -> Option<&AtlasHeadline> {
        self.durations.iter().min_by(|a, b| a.smallest_m_s.total_cmp(&b.smallest_m_s))
    }

    /// The cells as CSV.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from(
            "duration_s,phase,direction_deg,survived_m_s,fallen_m_s,survived_n_s,survived_n,strides_to_recover,\
             fall_criterion,trials,strides\n",
        );
        for c in &self.cells {
            let impulse_n_s = self.mass_kg * c.survived_m_s;
            text += &format!(
                "{},{},{},{},{},{},{},{},{},{},{}\n",
                c.duration_s,
                c.phase,
                c.direction_deg,
                c.survived_m_s,
                c.fallen_m_s.map_or_else(String::new, |v| v.to_string()),
                impulse_n_s,
                impulse_n_s / c.duration_s,
                c.strides_to_recover.map_or_else(String::new, |n| n.to_string()),
                c.fall_criterion.map_or("", FallCriterion::name),
                c.trials,
                c.strides
            );
        }
        text
    }
}

/// The words for a direction.
///
/// # Example
///
/// ```
/// assert_eq!(stridemap_record::direction_words(45.0), "forward and to the stance side");
/// ```
#[must_use]
pub fn direction_words(direction_deg: f64) -> &'static str {
    const WORDS: [&str; 8] = [
        "forward",
        "forward and to the stance side",
        "to the stance side",
        "back and to the stance side",
        "back",
        "back and to the swing side",
        "to the swing side",
        "forward and to the swing side",
    ];
    let eighth = (direction_deg.rem_euclid(360.0) / 45.0).round() as usize;
    WORDS[eighth % WORDS.len()]
}

/// The cells of a table.
pub(crate) fn cells(table: &Table) -> Result<Vec<AtlasCell>, RecordError> {
    let cells = table.rows().map(|row| {
        let row = row?;
        let given = |name: &str| row.cell(name).map(|text| !text.is_empty());
        let criterion = || row.word("fall_criterion", &FallCriterion::ALL, FallCriterion::name);
        Ok(AtlasCell {
            duration_s: row.number("duration_s")?,
            phase: row.number("phase")?,
            direction_deg: row.number("direction_deg")?,
            survived_m_s: row.number("survived_m_s")?,
            fallen_m_s: given("fallen_m_s")?.then(|| row.number("fallen_m_s")).transpose()?,
            strides_to_recover: given("strides_to_recover")?.then(|| row.count("strides_to_recover")).transpose()?,
            fall_criterion: given("fall_criterion")?.then(criterion).transpose()?,
            trials: row.count("trials")?,
            strides: row.count("strides")?,
        })
    });
    cells.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Rows;
    use std::path::Path;

    #[test]
    fn a_table_comes_back_as_it_was() {
        let cell = AtlasCell {
            duration_s: 0.08,
            phase: 0.125,
            direction_deg: 45.0,
            survived_m_s: 0.1,
            fallen_m_s: None,
            strides_to_recover: None,
            fall_criterion: None,
            trials: 8,
            strides: 90,
        };
        let fell = AtlasCell {
            fallen_m_s: Some(0.109_375),
            strides_to_recover: Some(4),
            fall_criterion: Some(FallCriterion::Tilt),
            ..cell
        };
        let atlas = PushAtlas { mass_kg: 95.0, largest_m_s: 1.2, ..PushAtlas::default() }.with(vec![cell, fell]);
        let table = Table::parse(Path::new("push-atlas.csv"), &atlas.table(), Rows::All).unwrap();
        assert_eq!(cells(&table).unwrap(), atlas.cells);
    }
}
