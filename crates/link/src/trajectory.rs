//! A way through several postures, each at its time (`trajectory_msgs/JointTrajectory`).

/// A trajectory of some of a machine's joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Robot time at which it begins.
    pub start_s: f64,
    /// The points: time after the start, and one angle per joint of the machine; `None` for joints that it
    /// does not move.
    pub points: Vec<(f64, Vec<Option<f64>>)>,
}

/// The longest trajectory that is taken: while it lasts nobody need say anything.
const LONGEST_S: f64 = 30.0;

/// Why a trajectory is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrajectoryFault {
    /// It has no points, a point has not one entry per joint, or it moves no joint.
    WrongLength,
    /// An angle or a time is NaN or infinite.
    NotFinite,
    /// Times do not increase, are negative, or the whole takes too long.
    Times,
}

impl Trajectory {
    /// Whether it can be followed by a machine with this many joints.
    ///
    /// # Errors
    ///
    /// [`TrajectoryFault`].
    pub fn check(&self, joints: usize) -> Result<(), TrajectoryFault> {
        let Some((_, first)) = self.points.first() else {
            return Err(TrajectoryFault::WrongLength);
        };
        let moved = |p: &[Option<f64>]| p.iter().map(Option::is_some).collect::<Vec<_>>();
        let joints_moved = moved(first);
        let same = self.points.iter().all(|(_, p)| moved(p) == joints_moved);
        if first.len() != joints || !same || !joints_moved.contains(&true) {
            return Err(TrajectoryFault::WrongLength);
        }
        let finite = |p: &[Option<f64>]| p.iter().flatten().all(|angle| angle.is_finite());
        let all_finite = self.points.iter().all(|(t, p)| t.is_finite() && finite(p));
        if !all_finite || !self.start_s.is_finite() {
            return Err(TrajectoryFault::NotFinite);
        }
        let mut before_s = -f64::MIN_POSITIVE;
        for (t, _) in &self.points {
            if *t <= before_s || *t > LONGEST_S {
                return Err(TrajectoryFault::Times);
            }
            before_s = *t;
        }
        Ok(())
    }

    /// Robot time at which it ends.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.start_s + self.points.last().map_or(0.0, |(t, _)| *t)
    }

    /// Where every joint should be: straight from `from_rad` to the first point and on from point to point;
    /// joints that it does not move stay at `from_rad`.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_link::Trajectory;
    ///
    /// let points = vec![(1.0, vec![Some(0.2), None]), (3.0, vec![Some(0.0), None])];
    /// let trajectory = Trajectory { start_s: 5.0, points };
    /// assert_eq!(trajectory.at(5.5, &[0.0, 0.7]), [0.1, 0.7]);
    /// assert_eq!(trajectory.at(7.0, &[0.0, 0.7]), [0.1, 0.7]);
    /// assert_eq!(trajectory.at(99.0, &[0.0, 0.7]), [0.0, 0.7]);
    /// ```
    #[must_use]
    pub fn at(&self, now_s: f64, from_rad: &[f64]) -> Vec<f64> {
        let elapsed_s = (now_s - self.start_s).max(0.0);
        let next = self.points.iter().position(|(t, _)| *t > elapsed_s);
        let joint = |j: usize, from: f64| {
            let angle = |k: usize| {
                let (t, point) = &self.points[k];
                (*t, point.get(j).copied().flatten().unwrap_or(from))
            };
            match next {
                None => self.points.len().checked_sub(1).map_or(from, |k| angle(k).1),
                Some(k) => {
                    let (t0, a0) = if k == 0 { (0.0, from) } else { angle(k - 1) };
                    let (t1, a1) = angle(k);
                    a0 + (a1 - a0) * (elapsed_s - t0) / (t1 - t0)
                }
            }
        };
        from_rad.iter().enumerate().map(|(j, from)| joint(j, *from)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_refused() {
        let of = |points: &[(f64, [Option<f64>; 2])]| Trajectory {
            start_s: 0.0,
            points: points.iter().map(|(t, p)| (*t, p.to_vec())).collect(),
        };
        let good = [(0.0, [Some(0.1), None]), (1.0, [Some(0.2), None])];
        assert_eq!(of(&good).check(2), Ok(()));
        assert_eq!(of(&good).check(3), Err(TrajectoryFault::WrongLength));
        for (points, fault) in [
            (vec![], TrajectoryFault::WrongLength),
            (vec![(0.0, [None, None])], TrajectoryFault::WrongLength),
            (vec![(0.0, [Some(0.1), None]), (1.0, [None, Some(0.1)])], TrajectoryFault::WrongLength),
            (vec![(0.0, [Some(f64::NAN), None])], TrajectoryFault::NotFinite),
            (vec![(1.0, [Some(0.1), None]), (1.0, [Some(0.1), None])], TrajectoryFault::Times),
            (vec![(-1.0, [Some(0.1), None])], TrajectoryFault::Times),
            (vec![(99.0, [Some(0.1), None])], TrajectoryFault::Times),
        ] {
            assert_eq!(of(&points).check(2), Err(fault), "{points:?}");
        }
    }
}
