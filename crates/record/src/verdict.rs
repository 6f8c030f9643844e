//! `verdict.json`: may a policy be deployed?

use serde::{Deserialize, Serialize};

/// What is said of a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ruling {
    /// The whole interval is within the limit.
    Pass,
    /// The whole interval is beyond the limit.
    Fail,
    /// The limit lies within the interval, or there is none.
    CannotTell,
}

impl Ruling {
    /// What is said of an interval and a limit that its upper end must not exceed.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_record::Ruling;
    ///
    /// assert_eq!(Ruling::at_most(0.1, (0.02, 0.09)), Ruling::Pass);
    /// assert_eq!(Ruling::at_most(0.1, (0.02, 0.2)), Ruling::CannotTell);
    /// assert_eq!(Ruling::at_least(0.1, (0.02, 0.09)), Ruling::Fail);
    /// ```
    #[must_use]
    pub fn at_most(limit: f64, (low, high): (f64, f64)) -> Self {
        if high <= limit {
            Self::Pass
        } else if low > limit {
            Self::Fail
        } else {
            Self::CannotTell
        }
    }

    /// The same of a limit that its lower end must reach.
    #[must_use]
    pub fn at_least(limit: f64, (low, high): (f64, f64)) -> Self {
        Self::at_most(-limit, (-high, -low))
    }

    /// One ruling on all: fails if one does, passes if all do.
    #[must_use]
    pub fn of_all(rulings: impl IntoIterator<Item = Self>) -> Self {
        rulings.into_iter().fold(Self::Pass, |all, one| match (all, one) {
            (Self::Fail, _) | (_, Self::Fail) => Self::Fail,
            (Self::Pass, Self::Pass) => Self::Pass,
            _ => Self::CannotTell,
        })
    }

    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::CannotTell => "cannot tell",
        }
    }
}

/// A number with its interval, against its limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// What it is: a key of the task's `[verdict]` without its end.
    pub name: String,
    /// What it is, in words.
    pub about: String,
    /// Its unit; empty for a share.
    pub unit: String,
    /// The number; null if there is none.
    pub value: Option<f64>,
    /// Lower end of its 95 % interval.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
    /// The limit.
    pub limit: f64,
    /// Whether the limit is a most; otherwise a least.
    pub at_most: bool,
    /// What is said of it.
    pub ruling: Ruling,
    /// Where the number comes from, or why there is none.
    pub because: String,
    /// Strides behind it.
    pub strides: usize,
    /// Root of the random streams behind it.
    pub seed: u64,
}

impl Judged {
    /// The number with its interval, its limit and where it comes from, in a line.
    #[must_use]
    pub fn line(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let number = |x: f64| format!("{:.3}", x + 0.0);
        let found = match (self.value, self.low, self.high) {
            (Some(value), Some(low), Some(high)) => {
                format!("{} ({} to {}){unit}", number(value), number(low), number(high))
            }
            _ => "no number".to_owned(),
        };
        let word = if self.at_most { "at most" } else { "at least" };
        format!(
            "{}: {found}, {word} {}{unit}; {} strides, seed {}; {}",
            self.about,
            number(self.limit),
            self.strides,
            self.seed,
            self.because
        )
    }
}

/// What is said of a policy, or of one beside another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunVerdict {
    /// Version of the file.
    pub format: u32,
    /// The run; of a comparison both.
    pub runs: Vec<String>,
    /// What is said of all.
    pub ruling: Ruling,
    /// Of each number.
    pub judged: Vec<Judged>,
}

impl RunVerdict {
    /// What is said of these numbers.
    #[must_use]
    pub fn of(runs: Vec<String>, judged: Vec<Judged>) -> Self {
        Self { format: crate::FORMAT, runs, ruling: Ruling::of_all(judged.iter().map(|j| j.ruling)), judged }
    }

    /// A table in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "# {}: {}\n\n| | | value | 95 % interval | limit | strides | seed | |\n|---|---|---|---|---|---|---|---|\n",
            self.runs.join(" against "),
            self.ruling.words()
        );
        let number = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.3}"));
        for j in &self.judged {
            let unit = if j.unit.is_empty() { String::new() } else { format!(" {}", j.unit) };
            text += &format!(
                "| **{}** | {} | {}{unit} | {} to {} | {} {:.3} | {} | {} | {} |\n",
                j.ruling.words(),
                j.about,
                number(j.value),
                number(j.low),
                number(j.high),
                if j.at_most { "at most" } else { "at least" },
                j.limit,
                j.strides,
                j.seed,
                j.because.replace('|', "\\|")
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_failure_fails_and_one_doubt_is_a_doubt() {
        use Ruling::{CannotTell, Fail, Pass};
        for (all, of) in [(vec![], Pass), (vec![Pass, Pass], Pass), (vec![Pass, CannotTell], CannotTell)] {
            assert_eq!(Ruling::of_all(all), of);
        }
        assert_eq!(Ruling::of_all([CannotTell, Fail, Pass]), Fail);
    }
}
