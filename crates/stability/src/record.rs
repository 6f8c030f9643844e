//! A record of strides: what is known of a robot that walked.

use crate::error::StabilityError;
use crate::linear::{Looks, MOST_ACTIONS, Series};
use crate::rule::FallRule;

/// Most components of a state.
pub const MOST_STATES: usize = 5;

/// States at successive sections, in unbroken stretches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Names of the components, each with its unit at the end; d of them, 1 to [`MOST_STATES`].
    pub state: Vec<String>,
    /// Unbroken stretches of strides.
    pub bouts: Vec<Bout>,
    /// Mean duration of a stride, s, if it is known.
    pub stride_s: Option<f64>,
}

/// An unbroken stretch of strides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bout {
    /// n states of d components, in the units of their names.
    pub states: Vec<Vec<f64>>,
    /// The same states looked at a second time, n of d; empty where there was one look.
    pub second_looks: Vec<Vec<f64>>,
    /// The action after each state, n of m; empty where there is none.
    pub actions: Vec<Vec<f64>>,
    /// Which legs stood, n of them, to be told apart; empty where it is not known.
    pub sides: Vec<u8>,
    /// Whether the stride after the last state ended in a fall.
    pub fell: bool,
    /// The state at that fall, if a section was seen.
    pub fallen_state: Option<Vec<f64>>,
}

impl Bout {
    /// The rows from `from` up to `to`, which did not end in a fall.
    fn part(&self, from: usize, to: usize) -> Self {
        let cut = |rows: &[Vec<f64>]| rows.get(from..to).map(<[_]>::to_vec).unwrap_or_default();
        Self {
            states: cut(&self.states),
            second_looks: cut(&self.second_looks),
            actions: cut(&self.actions),
            sides: self.sides.get(from..to).map(<[_]>::to_vec).unwrap_or_default(),
            fell: false,
            fallen_state: None,
        }
    }
}

impl Record {
    /// Rows: sections at which the robot was seen on its feet.
    #[must_use]
    pub fn strides(&self) -> usize {
        self.bouts.iter().map(|bout| bout.states.len()).sum()
    }

    /// Falls.
    #[must_use]
    pub fn falls(&self) -> usize {
        self.bouts.iter().filter(|bout| bout.fell).count()
    }

    /// Whether actions were recorded, and varied.
    pub(crate) fn is_probed(&self) -> bool {
        let mut actions = self.bouts.iter().flat_map(|bout| &bout.actions);
        actions.next().is_some_and(|first| actions.any(|other| other != first))
    }

    /// Every size is right and every number finite.
    pub(crate) fn check(&self) -> Result<(), StabilityError> {
        let d = self.state.len();
        if d == 0 || d > MOST_STATES {
            return Err(StabilityError::States { found: d, most: MOST_STATES });
        }
        if self.strides() < 3 {
            return Err(StabilityError::TooFew { found: self.strides(), needed: 3 });
        }
        let m = self.bouts.iter().find_map(|bout| bout.actions.first()).map_or(0, Vec::len);
        if m > MOST_ACTIONS {
            return Err(StabilityError::Actions { found: m, most: MOST_ACTIONS });
        }
        let mut row = 0;
        for bout in &self.bouts {
            let n = bout.states.len();
            let rows = |all: &[Vec<f64>], wide: usize, may_lack: bool| {
                (all.len() == n || may_lack && all.is_empty()) && all.iter().all(|row| row.len() == wide)
            };
            let whole = rows(&bout.states, d, false)
                && rows(&bout.second_looks, d, true)
                && rows(&bout.actions, m, m == 0)
                && (bout.sides.is_empty() || bout.sides.len() == n);
            if !whole {
                return Err(StabilityError::Shape { row });
            }
            for (k, numbers) in bout.states.iter().enumerate() {
                let more = bout.actions.get(k).into_iter().chain(bout.second_looks.get(k)).flatten();
                if numbers.iter().chain(more).any(|x| !x.is_finite()) {
                    return Err(StabilityError::NotFinite { row: row + k });
                }
            }
            row += n;
        }
        Ok(())
    }

    /// The record with every state beyond the rule taken as the fall in which its stretch ends.
    pub(crate) fn fallen(mut self, component: usize, rule: &FallRule) -> Self {
        let mut bouts = Vec::new();
        for mut bout in std::mem::take(&mut self.bouts) {
            let mut from = 0;
            for k in 0..bout.states.len() {
                if rule.is_fall(bout.states[k][component]) {
                    let before = bout.part(from, k);
                    if before.states.is_empty() {
                        from = k + 1;
                        continue;
                    }
                    bouts.push(Bout { fell: true, fallen_state: Some(bout.states[k].clone()), ..before });
                    from = k + 1;
                }
            }
            let (fell, end) = (bout.fell, bout.states.len());
            let state = bout.fallen_state.take();
            let rest = bout.part(from, end);
            if !rest.states.is_empty() {
                bouts.push(Bout { fell, fallen_state: state, ..rest });
            }
        }
        self.bouts = bouts;
        self
    }

    /// `count` pieces of equal length, one after the other.
    pub(crate) fn pieces(&self, count: usize) -> Vec<Self> {
        let all = self.strides();
        (0..count).map(|i| self.between(i * all / count, (i + 1) * all / count)).collect()
    }

    /// The rows from `from` up to `to`: a piece of the record.
    #[must_use]
    pub fn between(&self, from: usize, to: usize) -> Self {
        let mut bouts = Vec::new();
        let mut first = 0;
        for bout in &self.bouts {
            let n = bout.states.len();
            let (a, b) = (from.clamp(first, first + n) - first, to.clamp(first, first + n) - first);
            first += n;
            if a < b {
                let fallen_state = bout.fallen_state.clone().filter(|_| b == n);
                bouts.push(Bout { fell: bout.fell && b == n, fallen_state, ..bout.part(a, b) });
            }
        }
        Self { bouts, ..self.clone() }
    }
}

/// A record in components of zero mean and unit variance.
pub(crate) struct Standardised<const D: usize> {
    pub series: Series<D>,
    /// Standard deviations taken out.
    pub stds: [f64; D],
    /// Differences of two looks, where there are two at every section.
    pub looks: Option<Looks<D>>,
    /// Those differences themselves.
    pub differences: Vec<Vec<[f64; D]>>,
}

/// Means of rows by a label of theirs.
fn centre<const D: usize>(rows: &mut [Vec<[f64; D]>], labels: &[Vec<u8>]) {
    let mut sums: std::collections::BTreeMap<u8, (f64, [f64; D])> = std::collections::BTreeMap::new();
    for (row, label) in rows.iter().flatten().zip(labels.iter().flatten()) {
        let (n, sum) = sums.entry(*label).or_insert((0.0, [0.0; D]));
        *n += 1.0;
        sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
    }
    for (row, label) in rows.iter_mut().flatten().zip(labels.iter().flatten()) {
        if let Some((n, sum)) = sums.get(label) {
            row.iter_mut().zip(sum).for_each(|(x, s)| *x -= s / n);
        }
    }
}

impl<const D: usize> Standardised<D> {
    /// Of a record that was checked. Legs that differ are told apart by their means.
    pub(crate) fn of(record: &Record) -> Result<Self, StabilityError> {
        let fixed = |rows: &[Vec<f64>]| -> Vec<[f64; D]> {
            rows.iter().map(|row| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0))).collect()
        };
        let mut bouts: Vec<Vec<[f64; D]>> = record.bouts.iter().map(|bout| fixed(&bout.states)).collect();
        let two = record.bouts.iter().all(|bout| !bout.second_looks.is_empty());
        let mut differences = Vec::new();
        if two {
            for (bout, states) in record.bouts.iter().zip(&mut bouts) {
                let mut apart = fixed(&bout.second_looks);
                for (second, first) in apart.iter_mut().zip(states.iter_mut()) {
                    for i in 0..D {
                        (first[i], second[i]) = (0.5 * (first[i] + second[i]), second[i] - first[i]);
                    }
                }
                differences.push(apart);
            }
        }
        let sided = record.bouts.iter().all(|bout| !bout.sides.is_empty());
        let labels = |sided: bool| -> Vec<Vec<u8>> {
            let of = |b: &Bout| if sided { b.sides.clone() } else { vec![0; b.states.len()] };
            record.bouts.iter().map(of).collect()
        };
        let n = record.strides() as f64;
        let means: [f64; D] = std::array::from_fn(|i| bouts.iter().flatten().map(|x| x[i]).sum::<f64>() / n);
        centre(&mut bouts, &labels(sided));
        centre(&mut differences, &labels(false));
        let squares: [f64; D] = std::array::from_fn(|i| bouts.iter().flatten().map(|x| x[i] * x[i]).sum());
        let stds = squares.map(|s| (s / n).sqrt());
        if let Some(i) = (0..D).find(|i| stds[*i] <= 1e-12 * (1.0 + means[*i].abs())) {
            return Err(StabilityError::Constant { name: record.state[i].clone() });
        }
        for row in bouts.iter_mut().chain(&mut differences).flatten() {
            row.iter_mut().zip(&stds).for_each(|(x, sd)| *x /= sd);
        }
        let looks = two.then(|| Looks {
            squares: std::array::from_fn(|i| differences.iter().flatten().map(|e| e[i] * e[i]).sum()),
            count: n - 1.0,
        });
        let (actions, m) = Self::actions(record);
        Ok(Self { series: Series { bouts, actions, m }, stds, looks, differences })
    }

    /// Actions of zero mean and unit variance; those that never varied are left out.
    fn actions(record: &Record) -> (Vec<Vec<[f64; MOST_ACTIONS]>>, usize) {
        let n = record.strides() as f64;
        let wide = record.bouts.iter().find_map(|bout| bout.actions.first()).map_or(0, Vec::len);
        let column = |j: usize| record.bouts.iter().flat_map(move |b| b.actions.iter().map(move |u| u[j]));
        let mut scaled = Vec::new();
        for j in 0..wide {
            let mean = column(j).sum::<f64>() / n;
            let std = (column(j).map(|u| (u - mean).powi(2)).sum::<f64>() / n).sqrt();
            if std > 1e-12 * (1.0 + mean.abs()) {
                scaled.push((j, mean, std));
            }
        }
        let of = |bout: &Bout| {
            let mut rows = vec![[0.0; MOST_ACTIONS]; bout.states.len()];
            for (row, u) in rows.iter_mut().zip(&bout.actions) {
                for (out, (j, mean, std)) in row.iter_mut().zip(&scaled) {
                    *out = (u[*j] - mean) / std;
                }
            }
            rows
        };
        (record.bouts.iter().map(of).collect(), scaled.len())
    }
}
