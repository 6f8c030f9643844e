//! `transitions.csv` and `record.csv`: strides as lines of a CSV file, and back.

use std::path::Path;

use serde::{Deserialize, Serialize};
use stridemap_process::{ProcessSpec, State, StrideEnd};
use stridemap_robot::Side;

use crate::error::RecordError;
use crate::files::read_bytes;
use crate::stride::{Fall, FallCriterion, Motion, StrideMeasures, StridePhase, StrideRole, Transition, side_name};
use crate::table::{Row, Rows, Table};

/// Why a stride was a fall or a stall; empty cells where it was none. Tables of earlier versions lack them.
const FALL: [&str; 3] = ["fall_criterion", "fall_value", "fall_threshold"];

/// Before the names of how the base moved: as the robot measured it, and as a simulator knows it.
const MOTION: [&str; 2] = ["stride_", "true_"];

const FIRST: [&str; 7] = ["iteration", "phase", "role", "episode", "k", "time_s", "stance"];

/// The column of `record.csv` that the other table has not: the measured policy.
const WHAT: &str = "what";

/// `columns.json`: the names of a process's components, and with them the columns of its tables, one line per
/// stride. Numbers are written with as many digits as bring back the same bits.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Columns {
    /// Components of the state, with their unit: `psi_roll_deg`.
    pub state: Vec<String>,
    /// Components of the action: `step_amplitude_deg`.
    pub action: Vec<String>,
    /// Components of the goal: `forward_speed_m_s`; left out where a task has one purpose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub goal: Vec<String>,
}

impl Columns {
    /// Those of a process.
    #[must_use]
    pub fn new(spec: &ProcessSpec) -> Self {
        Self {
            state: spec.state.iter().map(|d| d.name.clone()).collect(),
            action: spec.action.iter().map(|d| d.name.clone()).collect(),
            goal: spec.goal.iter().map(|d| d.name.clone()).collect(),
        }
    }

    /// The columns without which a stride is not known.
    fn needed(&self) -> Vec<String> {
        let mut columns: Vec<String> = FIRST.map(Into::into).into();
        columns.extend(self.state.iter().cloned());
        columns.extend(self.action.iter().map(|name| format!("last_{name}")));
        columns.extend(self.action.iter().cloned());
        columns.extend(self.goal.iter().map(|name| format!("goal_{name}")));
        columns.extend(self.state.iter().map(|name| format!("next_{name}")));
        columns.extend(["reward".into(), "end".into()]);
        columns
    }

    /// The header line of `transitions.csv`.
    #[must_use]
    pub fn header(&self) -> String {
        let mut columns = self.needed();
        columns.extend(StrideMeasures::COLUMNS.iter().map(|name| (*name).into()));
        if self.has_motion() {
            columns.extend(MOTION.iter().flat_map(|of| Motion::NAMES.map(|name| format!("{of}{name}"))));
        }
        columns.extend(FALL.map(Into::into));
        columns.join(",")
    }

    /// Whether the tables hold how the base moved: where a task has goals.
    const fn has_motion(&self) -> bool {
        !self.goal.is_empty()
    }

    /// The header line of `record.csv`.
    #[must_use]
    pub fn record_header(&self) -> String {
        format!("{WHAT},{}", self.header())
    }

    /// One line.
    #[must_use]
    pub fn row(&self, t: &Transition) -> String {
        let mut cells = vec![
            t.iteration.to_string(),
            t.phase.name().into(),
            t.role.name().into(),
            t.episode.to_string(),
            t.k.to_string(),
            t.time_s.to_string(),
            t.stance_name().into(),
        ];
        let goal: &[f64] = &t.goal;
        for numbers in [&t.state, &t.last_action, &t.action, goal, &t.next_state] {
            cells.extend(numbers.iter().map(ToString::to_string));
        }
        cells.push(t.reward.to_string());
        cells.push(t.end.name().into());
        let measures = t.measures.values().into_iter();
        cells.extend(measures.map(|value| value.to_string()));
        if self.has_motion() {
            let motion = [t.measures.motion, t.measures.true_motion];
            cells.extend(motion.iter().flat_map(Motion::values).map(|value| value.to_string()));
        }
        cells.extend(t.fall.map_or_else(Default::default, |fall| {
            let (value, threshold) = (fall.value.to_string(), fall.threshold.to_string());
            [fall.criterion.name().into(), value, threshold]
        }));
        cells.join(",")
    }

    /// Reads strides from a file: CSV as any program writes it, with a byte order mark, quotes, blank lines and
    /// whatever line ends; columns in any order, others passed over.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`], or [`RecordError::Content`] with the line and column at fault: a missing
    /// column, a cell that is no number, NaN, an infinity, an unknown word.
    pub fn read(&self, path: &Path, rows: Rows) -> Result<Vec<Transition>, RecordError> {
        self.strides(&Table::parse(path, &text(path)?, rows)?, rows)
    }

    /// Reads `record.csv`, each stride with the policy that was measured by it.
    ///
    /// # Errors
    ///
    /// As [`Self::read`].
    pub fn read_recorded(&self, path: &Path, rows: Rows) -> Result<Vec<(String, Transition)>, RecordError> {
        self.recorded(&Table::parse(path, &text(path)?, rows)?)
    }

    pub(crate) fn strides(&self, table: &Table, rows: Rows) -> Result<Vec<Transition>, RecordError> {
        if rows != Rows::First(0) {
            self.check(table)?;
        }
        table.rows().map(|row| self.stride(&row?)).collect()
    }

    /// The strides of `record.csv`, each with the policy that was measured by it.
    pub(crate) fn recorded(&self, table: &Table) -> Result<Vec<(String, Transition)>, RecordError> {
        self.check(table)?;
        let recorded = table.rows().map(|row| {
            let row = row?;
            Ok((row.cell(WHAT)?.to_owned(), self.stride(&row)?))
        });
        recorded.collect()
    }

    /// Refuses a table that lacks a column of these, or has it twice.
    fn check(&self, table: &Table) -> Result<(), RecordError> {
        let bad = |problem: String| Err(table.fault(Some(1), problem));
        let (needed, header) = (self.needed(), &table.header);
        for name in &needed {
            if header.iter().filter(|h| h == name).count() > 1 {
                return bad(format!("names the column {name} twice"));
            }
        }
        let missing: Vec<&String> = needed.iter().filter(|name| !table.has(name)).collect();
        if missing.is_empty() {
            return Ok(());
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
            return bad(format!("lacks the columns {named} of a stride of this task"));
        }
        let mark = [';', '\t'].into_iter();
        match mark.filter(|_| header.len() == 1).find(|mark| header.as_slice().contains(*mark)) {
            Some(mark) => bad(format!(
                "separates its columns by {mark:?}; a table of strides by commas, with a point in its numbers"
            )),
            None => bad("is no table of strides: its first line names none of their columns".into()),
        }
    }

    fn stride(&self, row: &Row<'_>) -> Result<Transition, RecordError> {
        let numbers = |names: &[String], prefix: &str| -> Result<State, RecordError> {
            let bounded = |name: &String| row.bounded(&format!("{prefix}{name}"));
            names.iter().map(bounded).collect()
        };
        let [criterion, value, threshold] = FALL;
        // None where there is no such column, or nothing in it.
        let fell = row.cell(criterion).is_ok_and(|cell| !cell.is_empty());
        let fall = fell.then(|| {
            Ok(Fall {
                criterion: row.word(criterion, &FallCriterion::ALL, FallCriterion::name)?,
                value: row.number(value)?,
                threshold: row.number(threshold)?,
            })
        });
        let motion = |of: &str| -> Result<Motion, RecordError> {
            let mut values = [0.0; 6];
            for (value, name) in values.iter_mut().zip(Motion::NAMES) {
                *value = row.optional(&format!("{of}{name}"))?;
            }
            Ok(Motion::of(values))
        };
        Ok(Transition {
            iteration: row.count("iteration")?,
            phase: row.word("phase", &StridePhase::ALL, StridePhase::name)?,
            role: row.word("role", &StrideRole::ALL, StrideRole::name)?,
            episode: row.count("episode")?,
            k: row.count("k")?,
            time_s: row.number("time_s")?,
            stance: row.word("stance", &STANCES, side_name)?,
            state: numbers(&self.state, "")?,
            last_action: numbers(&self.action, "last_")?,
            action: numbers(&self.action, "")?,
            goal: numbers(&self.goal, "goal_")?.into_iter().collect(),
            next_state: numbers(&self.state, "next_")?,
            reward: row.bounded("reward")?,
            end: row.word("end", &ENDS, StrideEnd::name)?,
            fall: fall.transpose()?,
            true_psi_roll_deg: None,
            true_forward_m: None,
            measures: {
                let [measured, truth] = MOTION;
                StrideMeasures {
                    motion: motion(measured)?,
                    true_motion: motion(truth)?,
                    ..StrideMeasures::read(|name| row.optional(name))?
                }
            },
        })
    }
}

const STANCES: [Option<Side>; 3] = [Some(Side::Left), Some(Side::Right), None];

const ENDS: [StrideEnd; 4] = [StrideEnd::Crossing, StrideEnd::Fell, StrideEnd::NoCrossing, StrideEnd::Aborted];

/// The text of a CSV file, its lines ended by line feeds.
fn text(path: &Path) -> Result<String, RecordError> {
    let text = String::from_utf8(read_bytes(path)?).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        RecordError::content(path, Some(line), "is not text in UTF-8")
    })?;
    // Alone, as an old Mac ends lines; the reader would not count them.
    Ok(if text.contains('\n') { text } else { text.replace('\r', "\n") })
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_process::{ActionDimension, StateDimension};

    fn table() -> Columns {
        Columns::new(&ProcessSpec {
            state: vec![StateDimension { name: "psi_roll_deg".into() }],
            action: vec![ActionDimension { name: "step_amplitude_deg".into(), lower: -1.0, upper: 1.0 }],
            goal: Vec::new(),
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
            goal: Default::default(),
            next_state: smallvec::smallvec![1e-300],
            reward: -0.25,
            end: StrideEnd::Crossing,
            fall: None,
            true_psi_roll_deg: None,
            true_forward_m: None,
            measures: StrideMeasures { energy_j: 12.5, ..Default::default() },
        }
    }

    #[test]
    fn what_is_written_comes_back_to_the_bit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let text = format!("{}\n{}\n", table().header(), table().row(&transition()));
        std::fs::write(&path, text).unwrap();
        assert_eq!(table().read(&path, Rows::All).unwrap(), vec![transition()]);
        assert!(table().read(&path, Rows::First(0)).unwrap().is_empty());
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
            ("lines of commas", format!("{plain}{}\n", ",".repeat(header.matches(',').count()))),
            ("no end of the last line", plain.trim_end().into()),
            ("spaces", plain.replace(',', " , ")),
            ("a column of row names", format!("\"\",{header}\n1,{row}\n2,{row}\n")),
        ] {
            std::fs::write(&path, &text).unwrap();
            let read = table().read(&path, Rows::All).unwrap();
            assert_eq!(read, vec![transition(), transition()], "{what}");
        }
        let bad = plain.replacen("-0.25", "-0.2.5", 1).replace('\n', "\r");
        std::fs::write(&path, bad).unwrap();
        let error = table().read(&path, Rows::All).unwrap_err().to_string();
        assert!(error.contains("transitions.csv:2: reward = \"-0.2.5\""), "{error}");
    }

    #[test]
    fn a_table_of_another_form_is_told_what_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let (header, row) = (table().header(), table().row(&transition()));
        for (bytes, expected) in [
            (format!("{header}\n{row}\n").replace(',', ";").into_bytes(), "columns by ';'"),
            (b"iteration,\nphase\xff".to_vec(), "transitions.csv:2: is not text in UTF-8"),
            (b"\xff\xfei\0t\0".to_vec(), "transitions.csv:1: is not text in UTF-8"),
            (format!("{header}\n{row},7\n").into_bytes(), "2: 33 cells under 32 columns"),
            (header.replace("reward", "Reward").into_bytes(), "lacks the columns reward (is it \"Reward\"?)"),
            (format!("{header},k\n").into_bytes(), "names the column k twice"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let error = table().read(&path, Rows::All).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn the_cause_of_a_fall_comes_back_and_older_tables_without_it_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("transitions.csv");
        let fell = Transition {
            end: StrideEnd::Fell,
            fall: Some(Fall { criterion: FallCriterion::Tilt, value: 45.1 + 0.2, threshold: 45.0 }),
            ..transition()
        };
        let text = format!("{}\n{}\n", table().header(), table().row(&fell));
        std::fs::write(&path, &text).unwrap();
        assert_eq!(table().read(&path, Rows::All).unwrap(), vec![fell.clone()]);
        std::fs::write(&path, text.replace(",tilt,", ",tipped,")).unwrap();
        let error = table().read(&path, Rows::All).unwrap_err().to_string();
        assert!(error.contains(":2: fall_criterion = \"tipped\"; it is one of psi_roll, height"), "{error}");
        let older: String = text.lines().map(|l| l.rsplitn(4, ',').last().unwrap().to_owned() + "\n").collect();
        assert!(!older.contains("fall_"));
        std::fs::write(&path, older).unwrap();
        let read = table().read(&path, Rows::All).unwrap();
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
            let error = table().read(&path, Rows::All).unwrap_err().to_string();
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
            table().read(&path, Rows::All).unwrap_err().to_string()
        };
        let error = said("hello\n");
        assert!(error.contains("transitions.csv:1: is no table of strides"), "{error}");
        let header = table().header().replace("next_psi_roll_deg", "psi");
        let error = said(&header);
        assert!(
            error.ends_with("transitions.csv:1: lacks the columns next_psi_roll_deg of a stride of this task"),
            "{error}"
        );
    }
}
