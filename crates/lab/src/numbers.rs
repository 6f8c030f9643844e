//! What a number in a task may be, by rule: a float is finite and of a size one can reckon with, an integer
//! is a count, and every count has a most.

use stridemap_config::walk;
use stridemap_record::LARGEST;
use toml::Value;

use crate::error::{Invalid, LabError};
use crate::task::Task;

/// Smallest size of a number that is not zero: the inverse of its square is still finite.
const SMALLEST: f64 = 1e-100;

/// Most that a count may be where [`COUNTS`] says nothing else.
const MOST: i64 = 100_000;

/// Counts with other bounds than 0 and [`MOST`]: key, least, most.
const COUNTS: [(&str, i64, i64); 13] = [
    ("algorithm.iterations", 1, 10_000),
    ("algorithm.strides_at_most", 0, 10_000_000),
    ("caution.proof.attempts", 1, 1_000),
    ("learner.actor_critic.max_bases", 0, 10_000),
    ("learner.controls.population", 0, 10_000),
    ("learner.controls.random_policies", 0, 10_000),
    ("learner.later_trials", 1, MOST),
    ("learner.search.generations", 0, 10_000),
    ("map.starts", 1, 1_000),
    // Which robot it is, from the seed: it counts nothing.
    ("robot.changes.individual", 0, i64::MAX),
    ("robot.changes.random", 0, 1),
    ("robot.hardware.individual", 0, i64::MAX),
    ("success.strides_at_most", 0, 10_000_000),
];

/// Checks every number of a task.
///
/// # Errors
///
/// [`LabError::Invalid`] with the key, the value and its bound; [`LabError::Config`] for what TOML cannot hold.
pub(crate) fn check(task: &Task) -> Result<(), LabError> {
    let mut fault = None;
    let walked = walk(task, &mut |key, value| {
        let requirement = match value {
            Value::Float(x) => beyond(*x),
            Value::Integer(n) => outside(*n, key),
            _ => None,
        };
        if let (None, Some(requirement)) = (&fault, requirement) {
            fault = Some(Invalid { key: key.to_owned(), requirement });
        }
    });
    walked.map_err(|error| LabError::Config(Box::new(error)))?;
    fault.map_or(Ok(()), |fault| Err(fault.into()))
}

fn beyond(x: f64) -> Option<String> {
    let size = x.abs();
    if size <= LARGEST && (size >= SMALLEST || size == 0.0) {
        return None;
    }
    let bound = if size < SMALLEST {
        format!("0 or at least {SMALLEST:e} in size")
    } else {
        format!("finite and at most {LARGEST:e} in size")
    };
    Some(format!("is {x:?}, must be {bound}"))
}

fn outside(n: i64, key: &str) -> Option<String> {
    let names = key.split('.').filter(|s| s.parse::<usize>().is_err());
    let key = names.collect::<Vec<_>>().join(".");
    let bounds = COUNTS.iter().find(|(name, ..)| *name == key);
    let (least, most) = bounds.map_or((0, MOST), |&(_, least, most)| (least, most));
    (!(least..=most).contains(&n)).then(|| format!("is {n}, must lie between {least} and {most}"))
}

#[cfg(test)]
mod tests {
    use crate::builtin::load;
    use stridemap_config::walk;
    use toml::Value;

    /// Every number of every task, set to what no number may be, is refused by its key before anything is
    /// made of it.
    #[test]
    fn no_key_takes_a_number_without_bound() {
        for name in ["stepping", "walking", "small-walking"] {
            let mut sets = Vec::new();
            walk(&load(name, &[]).unwrap().task, &mut |key, value| {
                let values: &[&str] = match value {
                    Value::Float(_) => &["nan", "inf", "-1e300", "1e-300"],
                    Value::Integer(_) => &["9223372036854775807"],
                    _ => &[],
                };
                sets.extend(values.iter().map(|v| (key.to_owned(), format!("{key}={v}"))));
            })
            .unwrap();
            assert!(sets.len() > 100);
            for (key, set) in sets {
                let error = load(name, std::slice::from_ref(&set)).unwrap_err();
                let text = error.to_string();
                assert!(error.is_request() && text.contains(&key), "{set}: {text}");
            }
        }
    }

    #[test]
    fn a_bound_is_named_with_key_and_value() {
        for (set, expected) in [
            ("map.starts=9223372036854775807", "map.starts: is 9223372036854775807, must lie between 1 and 1000"),
            ("reward.0.target_deg=inf", "reward.0.target_deg: is inf, must be finite and at most 1e12 in size"),
            ("collect.strides=[20, 1000000]", "collect.strides.1: is 1000000, must lie between 0 and 100000"),
        ] {
            let error = load("stepping", &[set.into()]).unwrap_err().to_string();
            assert!(error.ends_with(expected), "{error}");
        }
    }
}
