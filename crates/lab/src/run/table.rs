//! Transitions as lines of a CSV file, and back.

use std::collections::HashMap;
use std::path::Path;

use stridemap_returnmap::{ProcessSpec, State, StrideEnd};
use stridemap_robot::Side;

use crate::error::LabError;
use crate::fall::{Fall, FallCriterion};
use crate::measure::StrideMeasures;
use crate::numbers::LARGEST;
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

/// Why a stride was a fall or a stall; empty cells where it was none. Tables of earlier versions lack them.
const FALL_COLUMNS: [&str; 3] = ["fall_criterion", "fall_value", "fall_threshold"];

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
        columns.extend(FALL_COLUMNS.map(Into::into));
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
        cells.extend(t.fall.map_or_else(Default::default, |fall| {
            let (value, threshold) = (fall.value.to_string(), fall.threshold.to_string());
            [fall.criterion.name().into(), value, threshold]
        }));
        cells.join(",")
    }

    /// Reads the first `rows` strides of a file (all of them with `None`): CSV as any program writes it, with
    /// a byte order mark, quotes, blank lines and whatever line ends; columns in any order, others passed over.
    ///
    /// # Errors
    ///
    /// [`LabError::File`], or [`LabError::Content`] with the line and column at fault: a missing
    /// column, a cell that is no number, NaN, an infinity, an unknown word.
    pub fn read(&self, path: &Path, rows: Option<usize>) -> Result<Vec<Transition>, LabError> {
        let text = text(path)?;
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let fault = |error: csv::Error| {
            let line = error.position().map(|at| at.line() as usize);
            content(path, line, format!("is no CSV: {error}"))
        };
        let header = reader.headers().map_err(fault)?.clone();
        let columns = self.columns(path, &header, rows == Some(0))?;
        let mut transitions = Vec::new();
        for record in reader.records() {
            if rows.is_some_and(|rows| transitions.len() >= rows) {
                break;
            }
            let cells = record.map_err(fault)?;
            // Spreadsheets end a table with lines of nothing but commas.
            if cells.iter().all(str::is_empty) {
                continue;
            }
            let line = cells.position().map(|at| at.line() as usize);
            if cells.len() != header.len() {
                let problem = format!("{} cells under {} columns", cells.len(), header.len());
                return Err(content(path, line, problem));
            }
            transitions.push(self.transition(&Row {
                path,
                line,
                columns: &columns,
                cells: &cells,
            })?);
        }
        Ok(transitions)
    }

    /// Where each column is; `anything` is well where no row will be read.
    fn columns<'h>(
        &self,
        path: &Path,
        header: &'h csv::StringRecord,
        anything: bool,
    ) -> Result<HashMap<&'h str, usize>, LabError> {
        let bad = |problem: String| Err(content(path, Some(1), problem));
        let mut columns = HashMap::new();
        let needed = self.needed();
        for (at, name) in header.iter().enumerate() {
            if columns.insert(name, at).is_some() && needed.iter().any(|n| n == name) {
                return bad(format!("names the column {name} twice"));
            }
        }
        let missing: Vec<&String> = needed
            .iter()
            .filter(|name| !columns.contains_key(name.as_str()))
            .collect();
        if anything || missing.is_empty() {
            return Ok(columns);
        }
        if missing.len() < needed.len() {
            let named = missing.iter().map(|name| {
                let other = header.iter().find(|h| h.eq_ignore_ascii_case(name));
                match other {
                    Some(other) => format!("{name} (is it {other:?}?)"),
                    None => (*name).clone(),
                }
            });
            let named = named.collect::<Vec<_>>().join(", ");
            return bad(format!(
                "lacks the columns {named} of a stride of this task"
            ));
        }
        match (
            header.len(),
            [';', '\t']
                .iter()
                .find(|mark| header.as_slice().contains(**mark)),
        ) {
            (1, Some(mark)) => bad(format!(
                "separates its columns by {mark:?}; a table of strides by commas, with a point in its numbers"
            )),
            _ => bad("is no table of strides: its first line names none of their columns".into()),
        }
    }

    fn transition(&self, row: &Row<'_>) -> Result<Transition, LabError> {
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
        let stances = [Some(Side::Left), Some(Side::Right), None];
        Ok(Transition {
            iteration: row.count("iteration")?,
            phase: phases[row.word("phase", &phases.map(StridePhase::name))?],
            role: roles[row.word("role", &roles.map(StrideRole::name))?],
            episode: row.count("episode")?,
            k: row.count("k")?,
            time_s: row.number("time_s")?,
            stance: stances[row.word("stance", &["left", "right", ""])?],
            state: row.numbers(&self.states, "")?,
            last_action: row.numbers(&self.actions, "last_")?,
            action: row.numbers(&self.actions, "")?,
            next_state: row.numbers(&self.states, "next_")?,
            reward: row.bounded("reward")?,
            end: ends[row.word("end", &ends.map(StrideEnd::name))?],
            fall: row.fall()?,
            true_psi_roll_deg: None,
            true_forward_m: None,
            measures: StrideMeasures {
                duration_s: row.optional("stride_duration_s")?,
                forward_m: row.optional("stride_forward_m")?,
                left_m: row.optional("stride_left_m")?,
                turn_deg: row.optional("stride_turn_deg")?,
                psi_roll_deg: row.optional("stride_psi_roll_deg")?,
                psi_pitch_deg: row.optional("stride_psi_pitch_deg")?,
                psi_pitch_rate_deg_s: row.optional("stride_psi_pitch_rate_deg_s")?,
                yaw_rate_deg_s: row.optional("stride_yaw_rate_deg_s")?,
                heading_deg: row.optional("stride_heading_deg")?,
                gait_phase_deg: row.optional("stride_gait_phase_deg")?,
                mean_psi_pitch_rate_deg_s: row.optional("stride_mean_psi_pitch_rate_deg_s")?,
                energy_j: row.optional("stride_energy_j")?,
                peak_foot_load_n: row.optional("stride_peak_foot_load_n")?,
                posture_deviation_deg: row.optional("stride_posture_deviation_deg")?,
                ahead_m: row.optional("stride_ahead_m")?,
                cost_of_transport: row.optional("stride_cost_of_transport")?,
            },
        })
    }
}

fn content(path: &Path, line: Option<usize>, problem: String) -> LabError {
    LabError::Content {
        path: path.into(),
        line,
        problem,
    }
}

/// The text of a CSV file, its lines ended by line feeds.
fn text(path: &Path) -> Result<String, LabError> {
    let bytes = super::files::read_bytes(path)?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        content(path, Some(line), "is not text in UTF-8".into())
    })?;
    // Alone, as an old Mac ends lines; the reader would not count them.
    Ok(if text.contains('\n') {
        text
    } else {
        text.replace('\r', "\n")
    })
}

/// Most that anything in a file of strides counts to.
const MOST: usize = 1_000_000_000;

/// One line of a file of strides, its cells by the names of their columns.
struct Row<'a> {
    path: &'a Path,
    line: Option<usize>,
    columns: &'a HashMap<&'a str, usize>,
    cells: &'a csv::StringRecord,
}

impl Row<'_> {
    fn fault(&self, problem: String) -> LabError {
        content(self.path, self.line, problem)
    }

    fn cell(&self, name: &str) -> Result<&str, LabError> {
        let cell = self.columns.get(name).and_then(|at| self.cells.get(*at));
        cell.ok_or_else(|| self.fault(format!("no column {name}")))
    }

    fn number(&self, name: &str) -> Result<f64, LabError> {
        let text = self.cell(name)?;
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.fault(format!("{name} = {text:?} is not a finite number"))),
        }
    }

    /// A number that a map is fitted to: of a size one can reckon with, as in a task.
    fn bounded(&self, name: &str) -> Result<f64, LabError> {
        let value = self.number(name)?;
        if value.abs() > LARGEST {
            let bound = format!("{name} = {value:e} is larger than {LARGEST:e} in size");
            return Err(self.fault(bound));
        }
        Ok(value)
    }

    /// Zero where there is no such column.
    fn optional(&self, name: &str) -> Result<f64, LabError> {
        if self.columns.contains_key(name) {
            self.number(name)
        } else {
            Ok(0.0)
        }
    }

    fn count(&self, name: &str) -> Result<usize, LabError> {
        let text = self.cell(name)?;
        let count = text.parse::<usize>().ok().filter(|count| *count <= MOST);
        count.ok_or_else(|| {
            let bound = "is not a whole number of at most 1000000000";
            self.fault(format!("{name} = {text:?} {bound}"))
        })
    }

    fn word(&self, name: &str, words: &[&'static str]) -> Result<usize, LabError> {
        let text = self.cell(name)?;
        let known = words.iter().position(|word| *word == text);
        known.ok_or_else(|| {
            let words = words.join(", ");
            self.fault(format!("{name} = {text:?}; it is one of {words}"))
        })
    }

    /// The cause of a fall; none where there is no such column, or nothing in it.
    fn fall(&self) -> Result<Option<Fall>, LabError> {
        let [criterion, value, threshold] = FALL_COLUMNS;
        if !self.columns.contains_key(criterion) || self.cell(criterion)?.is_empty() {
            return Ok(None);
        }
        let words = FallCriterion::ALL.map(FallCriterion::name);
        Ok(Some(Fall {
            criterion: FallCriterion::ALL[self.word(criterion, &words)?],
            value: self.number(value)?,
            threshold: self.number(threshold)?,
        }))
    }

    fn numbers(&self, names: &[String], prefix: &str) -> Result<State, LabError> {
        let bounded = |name: &String| self.bounded(&format!("{prefix}{name}"));
        names.iter().map(bounded).collect()
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
            fall: None,
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
    fn csv_is_read_as_other_programs_write_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let (header, row) = (table().header(), table().row(&transition()));
        let plain = format!("{header}\n{row}\n{row}\n");
        let quoted = format!("\"{}\"\n", header.replace(',', "\",\"")) + &format!("{row}\n{row}\n");
        for (what, text) in [
            ("byte order mark", format!("\u{feff}{plain}")),
            ("byte order mark and quotes", format!("\u{feff}{quoted}")),
            ("quotes", quoted),
            ("carriage returns", plain.replace('\n', "\r")),
            ("both", plain.replace('\n', "\r\n")),
            ("blank lines", plain.replace('\n', "\n\n") + "\n \n"),
            (
                "lines of commas",
                format!("{plain}{}\n", ",".repeat(header.matches(',').count())),
            ),
            ("no end of the last line", plain.trim_end().into()),
            ("spaces", plain.replace(',', " , ")),
            (
                "a column of row names",
                format!("\"\",{header}\n1,{row}\n2,{row}\n"),
            ),
        ] {
            std::fs::write(&path, &text).unwrap();
            let read = table().read(&path, None).unwrap();
            assert_eq!(read, vec![transition(), transition()], "{what}");
        }
        let bad = plain.replacen("-0.25", "-0.2.5", 1).replace('\n', "\r");
        std::fs::write(&path, bad).unwrap();
        let error = table().read(&path, None).unwrap_err().to_string();
        assert!(
            error.contains("transitions.csv:2: reward = \"-0.2.5\""),
            "{error}"
        );
    }

    #[test]
    fn a_table_of_another_form_is_told_what_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let (header, row) = (table().header(), table().row(&transition()));
        for (bytes, expected) in [
            (
                format!("{header}\n{row}\n").replace(',', ";").into_bytes(),
                "columns by ';'",
            ),
            (
                b"iteration,\nphase\xff".to_vec(),
                "transitions.csv:2: is not text in UTF-8",
            ),
            (
                b"\xff\xfei\0t\0".to_vec(),
                "transitions.csv:1: is not text in UTF-8",
            ),
            (
                format!("{header}\n{row},7\n").into_bytes(),
                "2: 33 cells under 32 columns",
            ),
            (
                header.replace("reward", "Reward").into_bytes(),
                "lacks the columns reward (is it \"Reward\"?)",
            ),
            (
                format!("{header},k\n").into_bytes(),
                "names the column k twice",
            ),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let error = table().read(&path, None).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn the_cause_of_a_fall_comes_back_and_older_tables_without_it_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let fell = Transition {
            end: StrideEnd::Fell,
            fall: Some(Fall {
                criterion: FallCriterion::Tilt,
                value: 45.1 + 0.2,
                threshold: 45.0,
            }),
            ..transition()
        };
        let text = format!("{}\n{}\n", table().header(), table().row(&fell));
        std::fs::write(&path, &text).unwrap();
        assert_eq!(table().read(&path, None).unwrap(), vec![fell.clone()]);
        std::fs::write(&path, text.replace(",tilt,", ",tipped,")).unwrap();
        let error = table().read(&path, None).unwrap_err().to_string();
        assert!(
            error.contains(":2: fall_criterion = \"tipped\"; it is one of psi_roll, height"),
            "{error}"
        );
        let older: String = text
            .lines()
            .map(|l| l.rsplitn(4, ',').last().unwrap().to_owned() + "\n")
            .collect();
        assert!(!older.contains("fall_"));
        std::fs::write(&path, older).unwrap();
        let read = table().read(&path, None).unwrap();
        assert_eq!(read, vec![Transition { fall: None, ..fell }]);
    }

    #[test]
    fn a_nan_or_a_number_beyond_reckoning_in_a_log_is_named_by_line_and_column() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        for (cell, said) in [
            ("NaN", "reward = \"NaN\" is not a finite number"),
            ("1e200", "reward = 1e200 is larger than 1e12 in size"),
        ] {
            let row = table().row(&transition()).replace("-0.25", cell);
            std::fs::write(&path, format!("{}\n{row}\n", table().header())).unwrap();
            let error = table().read(&path, None).unwrap_err().to_string();
            let said = format!("transitions.csv:2: {said}");
            assert!(error.ends_with(&said), "{error}");
        }
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
