//! What a task says of its first fit before the robot moves: whether the strides that it plans can determine
//! what is fitted to them.

use crate::error::{Invalid, LabError};
use crate::samples::PART;
use crate::task::Task;

/// Checks that the first batch can be fitted.
///
/// # Errors
///
/// [`LabError::Invalid`] with the key at fault and both numbers.
pub(crate) fn check(task: &Task) -> Result<(), LabError> {
    let invalid = |key: String, requirement: String| Err(LabError::Invalid(Invalid { key, requirement }));
    let (kind, collect) = (task.learner.kind, &task.collect);
    if !kind.explores() {
        return Ok(());
    }
    let (needed, why) = kind.fewest_strides(task);
    let budget = task.algorithm.strides_at_most.unwrap_or(usize::MAX);
    let (planned, key) = match collect.until_error {
        // It explores in parts, and makes none that the budget does not hold.
        Some(_) if budget < PART => (0, "algorithm.strides_at_most"),
        Some(_) => (PART, "collect.until_error"),
        None => (collect.strides[0], "collect.strides"),
    };
    if planned < needed {
        return invalid(key.into(), format!("{planned} strides in the first batch, needs at least {needed} for {why}"));
    }
    if kind.uses_map() {
        let most = listed_in_all(task, planned);
        let outputs = task.state.len() + 1;
        if let Err(error) = stridemap_gp::check_memory(most, outputs) {
            return invalid(key.into(), format!("{most} strides in the map: {error}"));
        }
    }
    let slopes = kind.finds_slopes(task);
    for (i, action) in task.action.iter().enumerate() {
        let [low, high] = action.explore.center;
        let centers = low < high && planned > collect.explore.hold;
        let moves = action.bounds[0] < action.bounds[1] && (centers || action.explore.std > 0.0);
        if slopes && !moves {
            return invalid(
                format!("action.{i}"),
                format!(
                    "{} never changes in the first batch (its bounds, its explore), so that nothing says \
                     what it does",
                    action.modulates
                ),
            );
        }
    }
    Ok(())
}

/// Training strides of the batches that the task lists, and of their evaluations: those that surely come. A batch
/// that is repeated for as long as iterations last is asked about when it is fitted.
fn listed_in_all(task: &Task, first: usize) -> usize {
    let (algorithm, listed) = (&task.algorithm, &task.collect.strides);
    if algorithm.stop_below_improvement.is_some() {
        return first;
    }
    let batches = listed.len().min(algorithm.iterations);
    let evaluated = match (&task.caution, algorithm.evaluation_trains) {
        (Some(caution), _) => caution.proof.proof_strides,
        (None, true) => algorithm.evaluation_strides,
        (None, false) => 0,
    };
    let later: usize = listed[..batches].iter().skip(1).sum();
    let all = first + later + batches * evaluated;
    all.min(algorithm.strides_at_most.unwrap_or(usize::MAX))
}

#[cfg(test)]
mod tests {
    use crate::builtin::load;

    #[test]
    fn what_is_known_before_the_robot_moves_is_said_before_it_moves() {
        for (task, sets, expected) in [
            (
                "stepping",
                vec!["collect.strides=[2]"],
                "collect.strides: 2 strides in the first batch, needs at least 3 for a map",
            ),
            // State without the heading, and action, and the constant.
            (
                "walking",
                vec!["collect.strides=[11]"],
                "collect.strides: 11 strides in the first batch, needs at least 12 for a map whose mean has \
                 11 coefficients (map.mean)",
            ),
            (
                "walking",
                vec!["action.0.bounds=[0, 0]"],
                "action.0: walk_amplitude_deg never changes in the first batch (its bounds, \
                 its explore), so that nothing says what it does",
            ),
            (
                "stepping",
                vec!["collect.until_error=0.3", "algorithm.strides_at_most=19"],
                "algorithm.strides_at_most: 0 strides in the first batch, needs at least 3 for a map",
            ),
        ] {
            let sets: Vec<String> = sets.into_iter().map(str::to_owned).collect();
            let error = load(task, &sets).unwrap_err();
            assert!(error.is_request(), "{error:?}");
            assert!(error.to_string().ends_with(expected), "{error}");
        }
        for (task, set) in [("walking", "collect.strides=[12, 0]"), ("stepping", "algorithm.iterations=10000")] {
            assert!(load(task, &[set.into()]).is_ok(), "{set}");
        }
    }
}
