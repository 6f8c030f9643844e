//! From tables to records of strides: a row each, or a series in time that is cut at its sections.

use stridemap_stability::{Bout, Record};

use super::table::Table;
use crate::failure::Failure;

/// Columns that are not the state unless they are named.
const OTHERS: [&str; 5] = ["time_s", "bout", "side", "fell", "episode"];

/// Which columns are the state: those named, or the only one there is.
fn state_columns(table: &Table, named: &[String], but: &[usize]) -> Result<Vec<usize>, Failure> {
    if !named.is_empty() {
        return named.iter().map(|name| table.column(name.trim())).collect();
    }
    let may = |c: &usize| !OTHERS.contains(&table.names[*c].as_str()) && !but.contains(c);
    let columns: Vec<usize> = (0..table.names.len()).filter(may).collect();
    match columns.len() {
        1 => Ok(columns),
        _ => {
            let known = table.names.join(", ");
            Err(table.fault(None, format!("which columns are the state? --state A,B of {known}")))
        }
    }
}

/// Rows of some columns.
fn rows(table: &Table, columns: &[usize]) -> Result<Vec<Vec<f64>>, Failure> {
    let all: Vec<Vec<f64>> = columns.iter().map(|c| table.numbers(*c)).collect::<Result<_, _>>()?;
    Ok((0..table.len()).map(|k| all.iter().map(|column| column[k]).collect()).collect())
}

/// Small numbers for words.
fn labels(words: &[&str]) -> Vec<u8> {
    let mut known: Vec<&str> = Vec::new();
    let mut of = |word| {
        let at = known.iter().position(|k| *k == word).unwrap_or_else(|| {
            known.push(word);
            known.len() - 1
        });
        at.min(255) as u8
    };
    words.iter().map(|word| of(*word)).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Whether second looks are wanted.
pub fn two_looks(sensor_noise: Option<&str>) -> bool {
    matches!(sensor_noise, Some("two-looks" | "two_looks"))
}

/// A record of a table with one row a stride.
pub fn of_rows(table: &Table, state: &[String], action: &[String], two_looks: bool) -> Result<Record, Failure> {
    let actions: Vec<usize> = action.iter().map(|name| table.column(name.trim())).collect::<Result<_, _>>()?;
    let columns = state_columns(table, state, &actions)?;
    let names: Vec<String> = columns.iter().map(|c| table.names[*c].clone()).collect();
    let states = rows(table, &columns)?;
    let actions = if actions.is_empty() { Vec::new() } else { rows(table, &actions)? };
    let seconds = match two_looks {
        true => {
            let second = names.iter().map(|name| table.column(&format!("{name}_2")));
            rows(table, &second.collect::<Result<Vec<_>, _>>()?)?
        }
        false => Vec::new(),
    };
    let words = |name: &str| table.find(name).map(|c| table.words(c));
    let (bouts, sides) = (words("bout"), words("side").map(|w| labels(&w)));
    let fell = table.find("fell").map(|c| table.numbers(c)).transpose()?;
    let time = table.find("time_s").map(|c| table.numbers(c)).transpose()?;
    let mut record = Record { state: names, ..Record::default() };
    let mut durations = Vec::new();
    for k in 0..table.len() {
        let same = k > 0
            && bouts.as_ref().is_none_or(|b| b[k] == b[k - 1])
            && fell.as_ref().is_none_or(|f| f[k - 1].abs() < 0.5);
        if let Some(time) = &time
            && same
        {
            if time[k] <= time[k - 1] {
                let problem =
                    format!("column time_s: {} is not after {}; a new bout needs a column bout", time[k], time[k - 1]);
                return Err(table.fault(Some(k), problem));
            }
            durations.push(time[k] - time[k - 1]);
        }
        if !same {
            record.bouts.push(Bout::default());
        }
        let Some(bout) = record.bouts.last_mut() else { continue };
        bout.states.push(states[k].clone());
        bout.actions.extend(actions.get(k).cloned());
        bout.second_looks.extend(seconds.get(k).cloned());
        bout.sides.extend(sides.as_ref().map(|s| s[k]));
        bout.fell = fell.as_ref().is_some_and(|f| f[k].abs() >= 0.5);
    }
    record.stride_s = median(durations);
    Ok(record)
}

/// Where strides begin in a series: a column that passes a level upward.
struct Section {
    column: usize,
    level: f64,
}

impl Section {
    /// `roll_rate`: its zero; `left_load_n > 50`: touchdown. A load without a level gets a fifth of its largest.
    fn of(table: &Table, text: &str) -> Result<Self, Failure> {
        let (name, level) = match text.split_once('>') {
            Some((name, level)) => {
                let number = level.trim_start_matches('=').trim().parse::<f64>();
                let wrong = || Failure::request(format!("--section {text:?}: what follows > is no number"));
                (name.trim(), Some(number.ok().filter(|x| x.is_finite()).ok_or_else(wrong)?))
            }
            None => (text.trim(), None),
        };
        let column = table.column(name)?;
        let is_load = ["load", "force", "pressure"].iter().any(|word| table.names[column].contains(word));
        let level = match level {
            Some(level) => level,
            None if is_load => 0.2 * table.numbers(column)?.into_iter().fold(0.0, f64::max),
            None => 0.0,
        };
        Ok(Self { column, level })
    }

    /// Sections: the row before each, and how far between it and the next. A crossing within a third of the usual stride
    /// after another is a flutter and is none.
    fn crossings(&self, time: &[f64], values: &[f64]) -> Vec<(usize, f64)> {
        let all: Vec<(usize, f64)> = (1..values.len())
            .filter(|k| values[k - 1] < self.level && values[*k] >= self.level)
            .map(|k| (k - 1, (self.level - values[k - 1]) / (values[k] - values[k - 1])))
            .collect();
        let at = |c: &(usize, f64)| time[c.0] + c.1 * (time[c.0 + 1] - time[c.0]);
        let mut gaps: Vec<f64> = all.windows(2).map(|c| at(&c[1]) - at(&c[0])).collect();
        gaps.sort_by(f64::total_cmp);
        // Of the longer half, so that flutters do not decide what is usual.
        let usual = gaps.get(3 * gaps.len() / 4).copied().unwrap_or(0.0);
        let mut kept: Vec<(usize, f64)> = Vec::new();
        for crossing in all {
            if kept.last().is_none_or(|last| at(&crossing) - at(last) > usual / 3.0) {
                kept.push(crossing);
            }
        }
        kept
    }
}

/// A record of a series in time: states are other columns where the section's column passes its level. With
/// two looks the samples before and after it are both kept.
pub fn of_series(table: &Table, section: &str, state: &[String], two_looks: bool) -> Result<Record, Failure> {
    /// A stride so many times longer than usual is a pause.
    const PAUSE: f64 = 1.8;
    let section = Section::of(table, section)?;
    let time = table.numbers(table.column("time_s")?)?;
    if let Some(k) = (1..time.len()).find(|k| time[*k] <= time[k - 1]) {
        return Err(table.fault(Some(k), format!("column time_s: {} is not after {}", time[k], time[k - 1])));
    }
    let columns = state_columns(table, state, &[section.column])?;
    if columns.contains(&section.column) {
        let name = &table.names[section.column];
        return Err(table.fault(None, format!("{name} is the same at every section: it cannot be part of the state")));
    }
    let values = rows(table, &columns)?;
    let crossings = section.crossings(&time, &table.numbers(section.column)?);
    let at: Vec<f64> = crossings.iter().map(|(k, part)| time[*k] + part * (time[k + 1] - time[*k])).collect();
    let usual = median(at.windows(2).map(|t| t[1] - t[0]).collect());
    let mut record = Record {
        state: columns.iter().map(|c| table.names[*c].clone()).collect(),
        stride_s: usual,
        ..Record::default()
    };
    for (i, (k, part)) in crossings.iter().enumerate() {
        let pause = i == 0 || usual.is_some_and(|usual| at[i] - at[i - 1] > PAUSE * usual);
        if pause {
            record.bouts.push(Bout::default());
        }
        let Some(bout) = record.bouts.last_mut() else { continue };
        let (before, after) = (&values[*k], &values[k + 1]);
        if two_looks {
            bout.states.push(before.clone());
            bout.second_looks.push(after.clone());
        } else {
            bout.states.push(before.iter().zip(after).map(|(a, b)| a + part * (b - a)).collect());
        }
    }
    if record.strides() < 3 {
        let problem = format!("has {} sections; look at --section and its level", record.strides());
        return Err(table.fault(None, problem));
    }
    Ok(record)
}
