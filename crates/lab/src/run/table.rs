//! Transitions as lines of a CSV file, and back.

use std::path::Path;

use stridemap_returnmap::{ProcessSpec, State, StrideEnd};
use stridemap_robot::Side;

use crate::error::LabError;
use crate::measure::StrideMeasures;
use crate::strides::{StridePhase, StrideRole, Transition};

/// Names and values of the measures of a stride, in the order of their columns.
fn measures(m: &StrideMeasures) -> [(&'static str, f64); 16] {
    [
        ("stride_duration_s", m.duration_s),
        ("stride_forward_m", m.forward_m),
        ("stride_left_m", m.left_m),
        ("stride_turn_deg", m.turn_deg),
        ("stride_psi_roll_deg", m.psi_roll_deg),
        ("stride_psi_pitch_deg", m.psi_pitch_deg),
        ("stride_psi_pitch_rate_deg_s", m.psi_pitch_rate_deg_s),
        ("stride_yaw_rate_deg_s", m.yaw_rate_deg_s),
        ("stride_heading_deg", m.heading_deg),
        ("stride_gait_phase_deg", m.gait_phase_deg),
        (
            "stride_mean_psi_pitch_rate_deg_s",
            m.mean_psi_pitch_rate_deg_s,
        ),
        ("stride_energy_j", m.energy_j),
        ("stride_peak_foot_load_n", m.peak_foot_load_n),
        ("stride_posture_deviation_deg", m.posture_deviation_deg),
        ("stride_ahead_m", m.ahead_m),
        ("stride_cost_of_transport", m.cost_of_transport),
    ]
}

const FIRST_COLUMNS: [&str; 7] = [
    "iteration",
    "phase",
    "role",
    "episode",
    "k",
    "time_s",
    "stance",
];

/// The columns of a process, one line per stride. Numbers are written with as many digits as bring
/// back the same bits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TransitionTable {
    states: Vec<String>,
    actions: Vec<String>,
}

impl TransitionTable {
    /// The table of a process.
    #[must_use]
    pub fn new(spec: &ProcessSpec) -> Self {
        Self {
            states: spec.state.iter().map(|d| d.name.clone()).collect(),
            actions: spec.action.iter().map(|d| d.name.clone()).collect(),
        }
    }

    /// The columns without which a stride is not known.
    fn needed(&self) -> Vec<String> {
        let mut columns: Vec<String> = FIRST_COLUMNS.iter().map(ToString::to_string).collect();
        columns.extend(self.states.iter().cloned());
        columns.extend(self.actions.iter().map(|name| format!("last_{name}")));
        columns.extend(self.actions.iter().cloned());
        columns.extend(self.states.iter().map(|name| format!("next_{name}")));
        columns.extend(["reward".into(), "end".into()]);
        columns
    }

    /// The header line.
    #[must_use]
    pub fn header(&self) -> String {
        let mut columns = self.needed();
        columns.extend(
            measures(&StrideMeasures::default())
                .iter()
                .map(|(name, _)| (*name).into()),
        );
        columns.join(",")
    }

    /// One line.
    #[must_use]
    pub fn row(&self, t: &Transition) -> String {
        let stance = match t.stance {
            Some(Side::Left) => "left",
            Some(Side::Right) => "right",
            None => "",
        };
        let mut cells = vec![
            t.iteration.to_string(),
            t.phase.name().into(),
            t.role.name().into(),
            t.episode.to_string(),
            t.k.to_string(),
            t.time_s.to_string(),
            stance.into(),
        ];
        for numbers in [&t.state, &t.last_action, &t.action, &t.next_state] {
            cells.extend(numbers.iter().map(ToString::to_string));
        }
        cells.push(t.reward.to_string());
        cells.push(t.end.name().into());
        cells.extend(
            measures(&t.measures)
                .iter()
                .map(|(_, value)| value.to_string()),
        );
        cells.join(",")
    }

    /// Reads the first `rows` strides of a file (all of them with `None`). `what` columns before the
    /// first are passed over.
    ///
    /// # Errors
    ///
    /// [`LabError::File`], or [`LabError::Content`] with the line and column at fault: a missing
    /// column, a cell that is no number, NaN, an infinity, an unknown word.
    pub fn read(&self, path: &Path, rows: Option<usize>) -> Result<Vec<Transition>, LabError> {
        let text = super::files::read_text(path)?;
        let mut lines = text.lines().enumerate();
        let bad = |line: Option<usize>, problem: String| LabError::Content {
            path: path.into(),
            line,
            problem,
        };
        let header: Vec<&str> = lines
            .next()
            .map(|(_, l)| l.split(',').collect())
            .unwrap_or_default();
        let has = |name: &str| header.iter().any(|h| h.trim() == name);
        let needed = self.needed();
        let missing: Vec<&str> = needed
            .iter()
            .map(String::as_str)
            .filter(|c| !has(c))
            .collect();
        if rows != Some(0) && !missing.is_empty() {
            let problem = if missing.len() == needed.len() {
                "is no table of strides: its first line names none of their columns".into()
            } else {
                format!(
                    "lacks the columns {} of a stride of this task",
                    missing.join(", ")
                )
            };
            return Err(bad(Some(1), problem));
        }
        let mut transitions = Vec::new();
        for (index, line) in lines.take(rows.unwrap_or(usize::MAX)) {
            let cells: Vec<&str> = line.split(',').collect();
            let at = |problem: String| bad(Some(index + 1), problem);
            if cells.len() != header.len() {
                return Err(at(format!(
                    "{} cells under {} columns",
                    cells.len(),
                    header.len()
                )));
            }
            let cell = |name: &str| {
                let column = header.iter().position(|h| h.trim() == name);
                let text = column.and_then(|c| cells.get(c)).map(|c| c.trim());
                text.ok_or_else(|| at(format!("no column {name}")))
            };
            let number = |name: &str| -> Result<f64, LabError> {
                let text = cell(name)?;
                match text.parse::<f64>() {
                    Ok(value) if value.is_finite() => Ok(value),
                    _ => Err(at(format!("{name} = {text:?} is not a finite number"))),
                }
            };
            let optional = |name: &str| -> Result<f64, LabError> {
                if has(name) { number(name) } else { Ok(0.0) }
            };
            let count = |name: &str| -> Result<usize, LabError> {
                let text = cell(name)?;
                text.parse()
                    .map_err(|_| at(format!("{name} = {text:?} is not a whole number")))
            };
            let word = |name: &str, words: &[&'static str]| -> Result<usize, LabError> {
                let text = cell(name)?;
                words.iter().position(|w| *w == text).ok_or_else(|| {
                    at(format!(
                        "{name} = {text:?}; it is one of {}",
                        words.join(", ")
                    ))
                })
            };
            let numbers = |names: &[String], prefix: &str| -> Result<State, LabError> {
                names
                    .iter()
                    .map(|name| number(&format!("{prefix}{name}")))
                    .collect()
            };
            let phases = [
                StridePhase::Collect,
                StridePhase::Evaluate,
                StridePhase::Record,
            ];
            let roles = [
                StrideRole::Training,
                StrideRole::Evaluation,
                StrideRole::Record,
            ];
            let ends = [
                StrideEnd::Crossing,
                StrideEnd::Fell,
                StrideEnd::NoCrossing,
                StrideEnd::Aborted,
            ];
            transitions.push(Transition {
                iteration: count("iteration")?,
                phase: phases[word("phase", &phases.map(StridePhase::name))?],
                role: roles[word("role", &roles.map(StrideRole::name))?],
                episode: count("episode")?,
                k: count("k")?,
                time_s: number("time_s")?,
                stance: [Some(Side::Left), Some(Side::Right), None]
                    [word("stance", &["left", "right", ""])?],
                state: numbers(&self.states, "")?,
                last_action: numbers(&self.actions, "last_")?,
                action: numbers(&self.actions, "")?,
                next_state: numbers(&self.states, "next_")?,
                reward: number("reward")?,
                end: ends[word("end", &ends.map(StrideEnd::name))?],
                true_psi_roll_deg: None,
                true_forward_m: None,
                measures: StrideMeasures {
                    duration_s: optional("stride_duration_s")?,
                    forward_m: optional("stride_forward_m")?,
                    left_m: optional("stride_left_m")?,
                    turn_deg: optional("stride_turn_deg")?,
                    psi_roll_deg: optional("stride_psi_roll_deg")?,
                    psi_pitch_deg: optional("stride_psi_pitch_deg")?,
                    psi_pitch_rate_deg_s: optional("stride_psi_pitch_rate_deg_s")?,
                    yaw_rate_deg_s: optional("stride_yaw_rate_deg_s")?,
                    heading_deg: optional("stride_heading_deg")?,
                    gait_phase_deg: optional("stride_gait_phase_deg")?,
                    mean_psi_pitch_rate_deg_s: optional("stride_mean_psi_pitch_rate_deg_s")?,
                    energy_j: optional("stride_energy_j")?,
                    peak_foot_load_n: optional("stride_peak_foot_load_n")?,
                    posture_deviation_deg: optional("stride_posture_deviation_deg")?,
                    ahead_m: optional("stride_ahead_m")?,
                    cost_of_transport: optional("stride_cost_of_transport")?,
                },
            });
        }
        Ok(transitions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_returnmap::{ActionDimension, StateDimension};

    fn table() -> TransitionTable {
        TransitionTable::new(&ProcessSpec {
            state: vec![StateDimension {
                name: "psi_roll_deg".into(),
            }],
            action: vec![ActionDimension {
                name: "step_amplitude_deg".into(),
                lower: -1.0,
                upper: 1.0,
            }],
        })
    }

    fn transition() -> Transition {
        Transition {
            iteration: 2,
            phase: StridePhase::Evaluate,
            role: StrideRole::Training,
            episode: 1,
            k: 7,
            time_s: 0.1 + 0.2,
            stance: Some(Side::Right),
            state: smallvec::smallvec![std::f64::consts::PI],
            last_action: smallvec::smallvec![-0.1],
            action: smallvec::smallvec![1.0 / 3.0],
            next_state: smallvec::smallvec![1e-300],
            reward: -0.25,
            end: StrideEnd::Crossing,
            true_psi_roll_deg: None,
            true_forward_m: None,
            measures: StrideMeasures {
                energy_j: 12.5,
                ..Default::default()
            },
        }
    }

    #[test]
    fn what_is_written_comes_back_to_the_bit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let text = format!("{}\n{}\n", table().header(), table().row(&transition()));
        std::fs::write(&path, text).unwrap();
        assert_eq!(table().read(&path, None).unwrap(), vec![transition()]);
        assert!(table().read(&path, Some(0)).unwrap().is_empty());
    }

    #[test]
    fn a_nan_in_a_log_is_named_by_line_and_column() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let row = table().row(&transition()).replace("-0.25", "NaN");
        std::fs::write(&path, format!("{}\n{row}\n", table().header())).unwrap();
        let error = table().read(&path, None).unwrap_err().to_string();
        assert!(
            error.ends_with("transitions.csv:2: reward = \"NaN\" is not a finite number"),
            "{error}"
        );
    }

    #[test]
    fn a_file_without_the_columns_is_told_which_even_if_it_has_no_strides() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            table().read(&path, None).unwrap_err().to_string()
        };
        let error = said("hello\n");
        assert!(
            error.contains("transitions.csv:1: is no table of strides"),
            "{error}"
        );
        let header = table().header().replace("next_psi_roll_deg", "psi");
        let error = said(&header);
        assert!(
            error.ends_with(
                "transitions.csv:1: lacks the columns next_psi_roll_deg of a stride of this task"
            ),
            "{error}"
        );
    }
}
