//! What a record says, as a page of text.

use std::fmt::Write;

use crate::answer::{Analysis, Checks, Estimate, Method, Multipliers, NoiseSource};

/// A name without its unit, in words: `roll_rate_deg_s` is "roll rate".
fn words(name: &str) -> String {
    let mut parts: Vec<&str> = name.split('_').collect();
    while parts.len() > 1 && matches!(parts.last(), Some(&("deg" | "rad" | "s" | "m" | "n" | "nm" | "kg" | "hz"))) {
        parts.pop();
    }
    parts.join(" ")
}

/// A number as a person reads it: two or three digits that count.
fn number(x: f64) -> String {
    match x.abs() {
        a if a >= 1e6 => format!("{x:.1e}"),
        a if a >= 100.0 => format!("{x:.0}"),
        a if a >= 10.0 => format!("{x:.0}"),
        a if a >= 1.0 => format!("{x:.1}"),
        _ => format!("{x:.2}"),
    }
}

fn percent(p: f64) -> String {
    match 100.0 * p {
        p if p >= 10.0 => format!("{p:.0} %"),
        p if p >= 1.0 => format!("{p:.1} %"),
        p => format!("{p:.2} %"),
    }
}

fn yes(pass: bool) -> &'static str {
    if pass { "yes" } else { "NO" }
}

/// A p-value in words.
fn p_value(p: f64) -> String {
    if p < 0.001 { "p < 0.001".into() } else { format!("p = {p:.3}") }
}

impl Analysis {
    /// The analysis as a page of text, of lines of at most 120 characters where names allow it.
    #[must_use]
    pub fn page(&self) -> String {
        let mut page = self.head();
        match &self.multipliers {
            Some(m) => self.say_multipliers(m, &mut page),
            None => page += "Multipliers        not said, see below\n",
        }
        self.say_checks(&mut page);
        self.say_falls(&mut page);
        self.say_refused(&mut page);
        page
    }

    fn head(&self) -> String {
        let record = &self.record;
        let bouts = match record.bouts {
            1 => "one bout".to_owned(),
            n => format!("{n} bouts"),
        };
        let duration = record.stride_s.map_or(String::new(), |s| format!(", {s:.2} s each"));
        let falls = match record.falls {
            0 if self.fall.is_none() => String::new(),
            0 => ", no falls".into(),
            1 => ", 1 fall".into(),
            n => format!(", {n} falls"),
        };
        let state: Vec<String> = record.state.iter().map(|name| words(name)).collect();
        let sensor = self.multipliers.as_ref().map_or("", |m| match m.sensor_noise.source {
            NoiseSource::Given => "; sensor noise given",
            NoiseSource::TwoLooks => "; sensor noise from two looks",
            NoiseSource::Estimated => "; sensor noise estimated",
            NoiseSource::None => "; sensor exact",
        });
        let strides = record.strides;
        format!("{strides} strides in {bouts}{duration}{falls}.    state: {}{sensor}\n", state.join(", "))
    }

    fn say_multipliers(&self, m: &Multipliers, page: &mut String) {
        let plain = |e: Estimate| format!(" {:.2}  ({:.2} to {:.2})", e.value, e.low, e.high);
        let signed = |e: Estimate| format!("{:+.2}  ({:.2} to {:.2})", e.value, e.low, e.high);
        let h = m.half_life_strides;
        let _ = writeln!(
            page,
            "Slowest recovery  {}    a disturbance halves in {} strides ({} to {})",
            plain(m.largest),
            number(h.value),
            number(h.low),
            number(h.high)
        );
        let _ = writeln!(page, "Slow mode         {}", signed(m.slow));
        let alternates = if m.flip.value < 0.0 { "  alternates left and right" } else { "" };
        let _ = writeln!(page, "Flip              {}{alternates}", signed(m.flip));
        if m.method == Method::Pieces {
            let _ = writeln!(page, "{}", self.changed(m));
        } else if m.least_squares < m.largest.value - 0.02 {
            let why = match m.sensor_noise.source {
                NoiseSource::None => "because a short record hides slow modes",
                _ => "because noise hides memory",
            };
            let _ = writeln!(page, "Least squares would say {:.2}: too stable, {why}.", m.least_squares);
        } else {
            let _ = writeln!(page, "Least squares would say {:.2}.", m.least_squares);
        }
        *page += "Assumed, not shown: that the gait is stable (all below 1).\n";
    }

    /// Why intervals are from pieces.
    fn changed(&self, m: &Multipliers) -> String {
        let Checks { white_residuals, steady_mean, .. } = &self.checks;
        let shifts = format!("mean shifts, {}", p_value(steady_mean.p));
        let memory = format!("residuals are not white, {}", p_value(white_residuals.p));
        let what = match (steady_mean.pass, white_residuals.pass) {
            (false, false) => format!("{shifts}; {memory}"),
            (false, true) => shifts,
            _ => memory,
        };
        let Estimate { value, low, high } = m.largest;
        format!(
            "The gait changed during the record ({what}): intervals are from 4 pieces, {value:.2} ({low:.2} to {high:.2})."
        )
    }

    fn say_checks(&self, page: &mut String) {
        let c = &self.checks;
        let states = self.record.state.len();
        let _ = writeln!(
            page,
            "Checks   memory seen {} | residuals white {} | mean steady {} | not growing {} | {} strides for {states} \
             {}, {} needed {}",
            yes(c.excited.pass),
            yes(c.white_residuals.pass),
            yes(c.steady_mean.pass),
            yes(c.unstable.pass),
            c.long_enough.strides,
            if states == 1 { "state" } else { "states" },
            c.long_enough.needed,
            yes(c.long_enough.pass),
        );
    }

    fn say_falls(&self, page: &mut String) {
        let Some(fall) = &self.fall else { return };
        let rule = fall.rule.replacen('_', " ", 8);
        let near = match fall.boundary_sd {
            sd if sd < 0.0 => String::new(),
            sd => format!("; nearest stride {sd:.1} sd from it"),
        };
        let said = fall.probability_60_s.map_or("not said".into(), |p| format!("at most {}", percent(p.high)));
        let strides = match fall.strides_to_fall {
            Some(s) => format!(" Strides to a fall: at least {}.", number(s.low.floor())),
            None => String::new(),
        };
        let _ = writeln!(page, "Falling in 60 s    {said} (rule: {rule}{near}).{strides}");
        if let Some(high) = fall.counts_only.probability_60_s_high {
            let _ = writeln!(page, "                   From the count alone: at most {}.", percent(high));
        }
        if fall.strides_to_fall.is_some_and(|s| s.high.is_none()) {
            *page += "Not said: a mean time to fall (the interval spans more than two decades).\n";
        }
    }

    fn say_refused(&self, page: &mut String) {
        for refusal in self.refused.iter().filter(|r| r.because != "interval_over_two_decades") {
            let because = refusal.because.replace('_', " ");
            let _ = writeln!(page, "Not said: {} ({because}). To say it: {}.", refusal.key, refusal.remedy);
        }
        let unknown = self.multipliers.as_ref().is_some_and(|m| m.sensor_noise.source == NoiseSource::Estimated);
        if unknown {
            *page += "To narrow it: give sensor noise (--sensor-noise), or kick an action at random by about the gait's own \
                      scatter (--action).\n";
        }
    }
}
