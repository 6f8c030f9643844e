//! What the types of a task cannot say.

use crate::error::{LabError, unless};
use crate::reward::RewardQuantity;
use crate::task::Task;

impl Task {
    /// Checks what the types cannot, first fault first.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] with the key at fault, which the caller can place in a file; or the
    /// error of the room that owns the value.
    pub fn validate(&self) -> Result<(), LabError> {
        crate::numbers::check(self)?;
        self.check_name()?;
        self.robot.validate()?;
        self.gait(&self.robot.outline())?;
        self.section.validate()?;
        self.check_state()?;
        self.plant_actions()?;
        self.check_goal()?;
        self.check_reward()?;
        self.check_failure()?;
        self.check_collect()?;
        self.check_algorithm()?;
        self.check_record()?;
        if let Some(caution) = &self.caution {
            caution.validate()?;
        }
        self.verdict.map_or(Ok(()), |verdict| verdict.check())?;
        let kind = self.learner.kind;
        unless(
            self.caution.is_some() || !kind.needs_caution(),
            "learner.kind",
            format!(
                "{} searches within a trust region, and its policies are proven on the robot: it needs a [caution] \
                 section, which task {} has not (`compare {1} --controls` sets the task's learner beside \
                 simple controls)",
                kind.name(),
                self.name
            ),
        )?;
        unless(
            kind.follows_goals() != self.goal.is_empty(),
            "learner.kind",
            format!("{} {} [[goal]]", kind.name(), if kind.follows_goals() { "needs a" } else { "does not follow a" }),
        )?;
        kind.check(self)?;
        self.map_config().validate(self.state.len(), self.action.len())?;
        crate::suffices::check(self)
    }

    /// It names directories.
    fn check_name(&self) -> Result<(), LabError> {
        let name = &self.name;
        let plain = |c: char| c.is_alphanumeric() || " ._+=,@()-".contains(c);
        let ends = |c: char| c == ' ' || c == '.';
        unless(
            !name.is_empty()
                && name.len() <= 100
                && !name.starts_with(ends)
                && !name.ends_with(' ')
                && name.chars().all(plain),
            "name",
            format!(
                "is {name:?}; must be a name of at most 100 bytes: letters, digits and any of \"._+=,@()-\", with \
                 spaces between them and no point in front; it names directories"
            ),
        )
    }

    fn check_state(&self) -> Result<(), LabError> {
        let state = &self.state;
        unless(!state.is_empty(), "state", "needs at least one component")?;
        if let Some(i) = (1..state.len()).find(|&i| state[..i].contains(&state[i])) {
            unless(false, "state", format!("names {} twice", state[i].name()))?;
        }
        unless(
            self.map.invariant.is_empty(),
            "map.invariant",
            "is said by the components of the state (heading_deg); leave it out",
        )
    }

    fn check_goal(&self) -> Result<(), LabError> {
        for (i, goal) in self.goal.iter().enumerate() {
            let [low, high] = goal.range;
            let twice = self.goal[..i].iter().any(|g| g.name == goal.name);
            unless(!twice, format!("goal.{i}.name"), format!("names {} twice", goal.name.name))?;
            unless(low <= high, format!("goal.{i}.range"), format!("[{low}, {high}] must be in order"))?;
            unless(goal.hold > 0, format!("goal.{i}.hold"), "must be at least 1 stride")?;
            unless(goal.unit > 0.0, format!("goal.{i}.unit"), "must be positive: the error that counts as one")?;
            let known = goal.command.as_ref().is_none_or(|c| self.action.iter().any(|a| a.modulates == *c));
            unless(known, format!("goal.{i}.command"), "must be what one of the [[action]] modulates")?;
        }
        let asks = self.reward.iter().position(|t| t.quantity == RewardQuantity::GOAL_SQUARED_ERROR);
        match asks {
            Some(i) => unless(!self.goal.is_empty(), format!("reward.{i}"), "needs at least one [[goal]]"),
            None => unless(self.goal.is_empty(), "goal", "needs a [[reward]] of \"goal_squared_error\""),
        }
    }

    fn check_reward(&self) -> Result<(), LabError> {
        unless(!self.reward.is_empty(), "reward", "needs at least one [[reward]] term")?;
        for (i, term) in self.reward.iter().enumerate() {
            let word = match term.quantity.has_target {
                true => "needs",
                false => "has no use for",
            };
            unless(
                term.quantity.has_target == term.target_deg.is_some(),
                format!("reward.{i}"),
                format!("this quantity {word} target_deg"),
            )?;
            unless(term.weight.is_finite(), format!("reward.{i}.weight"), "must be finite")?;
        }
        Ok(())
    }

    fn check_failure(&self) -> Result<(), LabError> {
        let f = &self.failure;
        for (key, value, low, high) in [
            ("reward", f.reward, -1e6, 0.0),
            ("psi_roll_below_deg", f.psi_roll_below_deg.unwrap_or(0.0), -90.0, 90.0),
            ("com_height_below", f.com_height_below, 0.0, 1.0),
            ("tilt_above_deg", f.tilt_above_deg, 1.0, 180.0),
            ("no_section_s", f.no_section_s, 0.1, 60.0),
        ] {
            unless(
                (low..=high).contains(&value),
                format!("failure.{key}"),
                format!("is {value}, must lie in [{low}, {high}]"),
            )?;
        }
        Ok(())
    }

    fn check_collect(&self) -> Result<(), LabError> {
        let collect = &self.collect;
        unless(collect.explore.hold > 0, "collect.explore.hold", "must be at least 1 stride")?;
        unless(
            collect.strides.first().is_some_and(|first| *first > 0),
            "collect.strides",
            "must begin with at least 1 stride",
        )?;
        unless(
            collect.until_error.is_none_or(|e| e > 0.0 && e < 1.0),
            "collect.until_error",
            "must lie between 0 and 1, in spreads of the data",
        )
    }

    fn check_algorithm(&self) -> Result<(), LabError> {
        let a = &self.algorithm;
        unless(a.iterations > 0, "algorithm.iterations", "must be at least 1")?;
        let evaluated = a.evaluation_strides;
        unless(
            evaluated == 0 || a.evaluation_discard < evaluated,
            "algorithm.evaluation_discard",
            format!("must leave some of the {evaluated} evaluation strides"),
        )?;
        unless(
            a.stop_below_improvement.is_none() || evaluated > 0,
            "algorithm.stop_below_improvement",
            "needs evaluation_strides, or there is nothing to compare",
        )
    }

    fn check_record(&self) -> Result<(), LabError> {
        let r = &self.record;
        unless(r.strides > 0 && r.iteration_strides > 0, "record.strides", "must be at least 1")?;
        unless(r.walk_s.is_none_or(|s| (1.0..=3600.0).contains(&s)), "record.walk_s", "must be 1 to 3600 s")?;
        if let Some(speed_s) = r.speed_s {
            unless(
                speed_s >= 1.0 && r.walk_s.is_some_and(|walk_s| speed_s <= walk_s),
                "record.speed_s",
                format!("is {speed_s}, must be at least 1 s and at most record.walk_s"),
            )?;
        }
        unless((0.0..=600.0).contains(&r.pose_seconds), "record.pose_seconds", "must lie in [0, 600] s")
    }
}
