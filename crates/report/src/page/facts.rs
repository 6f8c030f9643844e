//! The words and tables of a page: what happened, in numbers and plain sentences.

use crate::draw::{escape, number, plain, plural, signed};
use crate::figures::{label, quantity};
use stridemap_map::SavedOutput;
use stridemap_process::StrideEnd;
use stridemap_record::{Measured, Run, Verdict};

/// Title of the page of one run.
pub(super) fn title(run: &Run) -> String {
    match (&run.summary, &run.provenance) {
        (Some(s), _) if !s.experiment.is_empty() => format!("{}, seed {}", s.experiment, s.seed),
        (_, Some(p)) => format!("{}, seed {}", run.name, p.seed),
        _ => run.name.clone(),
    }
}

/// Text with the subscripts of `ψ_roll` and `A_step` as HTML.
pub(super) fn subscripts(text: &str) -> String {
    let mut out = escape(text);
    for (name, sub) in [("ψ", "roll"), ("ψ", "pitch"), ("A", "step"), ("A", "walk"), ("A", "a,step")] {
        out = out.replace(&format!("{name}_{sub}"), &format!("{name}<sub>{sub}</sub>"));
    }
    out
}

/// What a recording shows, in words.
pub(super) fn recording_name(what: &str) -> String {
    match what {
        "nominal" => "before: nominal gait".to_owned(),
        "final" => "after: final policy".to_owned(),
        "push-nominal" => "pushed: nominal gait".to_owned(),
        "push" => "pushed: final policy".to_owned(),
        other => other.replace('-', " "),
    }
}

/// What a reader must know before the numbers: falls, an early end, too few data, files that are missing.
pub(super) fn remarks(run: &Run) -> String {
    let mut says: Vec<(bool, String)> = Vec::new();
    if !run.finished() {
        let last = run.transitions.last().map_or(0, |t| t.iteration);
        let why = match &run.stopped {
            Some(stop) => format!(
                "it stopped at {}: {}.",
                // To the second.
                stop.time.split('.').next().unwrap_or_default(),
                stop.reason.trim_end_matches('.')
            ),
            None => "it was killed, or it is still going.".to_owned(),
        };
        says.push((
            true,
            format!(
                "This run did not reach its end: {why} It left {} on the robot, the last of them in \
                 iteration {last}. Everything below is what it had written by then.",
                plural(run.transitions.len(), "stride")
            ),
        ));
    }
    let at = |end: StrideEnd| -> Vec<String> {
        run.transitions
            .iter()
            .enumerate()
            .filter(|(_, t)| t.end == end)
            .map(|(i, t)| format!("stride {} (iteration {})", i + 1, t.iteration))
            .collect()
    };
    for (end, what) in [
        (StrideEnd::Fell, "fell"),
        (StrideEnd::NoCrossing, "stalled"),
        (StrideEnd::Aborted, "was stopped by its equipment"),
    ] {
        let strides = at(end);
        if !strides.is_empty() {
            let shown = strides.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
            let more = if strides.len() > 8 { ", and more" } else { "" };
            says.push((true, format!("The robot {what} {} while learning: {shown}{more}.", times(strides.len()))));
        }
    }
    if run.finished() && run.falls() == (0, 0) {
        says.push((false, "The robot did not fall while learning.".to_owned()));
    }
    for (name, measured) in [
        ("nominal gait", run.summary.as_ref().and_then(|s| s.nominal)),
        ("final policy", run.summary.as_ref().and_then(|s| s.final_policy)),
    ] {
        let measured = measured.map(|m| m.performance);
        if let Some(m) = measured.filter(|m| m.falls > 0 || m.stalls > 0) {
            says.push((
                true,
                format!(
                    "Measured apart from learning, the {name} had {} and {} in {}.",
                    plural(m.falls, "fall"),
                    plural(m.stalls, "stall"),
                    plural(m.strides, "stride")
                ),
            ));
        }
    }
    if let Some(s) = &run.summary {
        let warned: usize = s.iterations.iter().map(|i| i.warnings.len()).sum();
        let back = s.iterations.iter().filter_map(|i| i.proof.as_ref());
        let back = back.filter(|p| p.verdict == Verdict::Warned).count();
        if warned > 0 {
            says.push((
                false,
                format!(
                    "The guard warned {} while learning; {} turned back by it.",
                    times(warned),
                    match back {
                        0 => "no policy was".to_owned(),
                        1 => "one policy was".to_owned(),
                        n => format!("{n} policies were"),
                    }
                ),
            ));
        }
        if !s.iterations.is_empty()
            && s.iterations.iter().all(|i| i.proof.as_ref().is_some_and(|p| p.verdict != Verdict::Proven))
        {
            says.push((true, "No policy was proven on the robot.".to_owned()));
        }
    }
    if run.transitions.len() == 1 {
        says.push((true, "This run has one stride. A spread, a map or a trend cannot be had from it.".to_owned()));
    } else if run.transitions.is_empty() {
        says.push((true, "This run has no stride yet.".to_owned()));
    }
    for problem in &run.problems {
        says.push((true, format!("Could not be read: {problem}.")));
    }
    if !run.missing.is_empty() {
        says.push((true, format!("Not in the run directory: {}.", run.missing.join(", "))));
    }
    if says.is_empty() {
        return String::new();
    }
    let items: String = says
        .iter()
        .map(|(bad, text)| format!("<li{}>{}</li>", if *bad { " class=\"bad\"" } else { "" }, escape(text)))
        .collect();
    format!("<ul class=\"says\">{items}</ul>")
}

fn times(n: usize) -> String {
    match n {
        1 => "once".to_owned(),
        2 => "twice".to_owned(),
        n => format!("{n} times"),
    }
}

fn reward(m: Option<Measured>) -> String {
    m.map_or_else(|| "\u{2013}".to_owned(), |m| number(m.performance.mean_reward, 3))
}

fn psi(m: Option<Measured>) -> String {
    m.and_then(|m| m.performance.mean_psi_roll_deg).map_or_else(|| "\u{2013}".to_owned(), |v| signed(v, 2))
}

/// The numbers of one run that one looks for first.
pub(super) fn tiles(run: &Run) -> String {
    let Some(s) = &run.summary else {
        return String::new();
    };
    let mut tiles = Vec::new();
    let speed =
        |m: Option<Measured>| m.and_then(|m| m.speed_m_s).map_or_else(|| "\u{2013}".to_owned(), |v| number(v, 3));
    let walks = (s.final_policy.or(s.nominal)).is_some_and(|m| m.speed_m_s.is_some());
    if walks {
        tiles.push((
            format!("{} \u{2192} {} m/s", speed(s.nominal), speed(s.final_policy)),
            "speed along the first heading, nominal to final".to_owned(),
        ));
        if let Some(upright) = s.final_policy.and_then(|m| m.upright_s) {
            let drift = s.final_policy.and_then(|m| m.drift_m);
            let drift =
                drift.map_or_else(String::new, |d| format!("; {} m to the left of the first heading", signed(d, 2)));
            tiles.push((
                format!("{} s", number(upright, 3)),
                format!("the final policy walked without a fall, up to 60{drift}"),
            ));
        }
    }
    let measured = s.nominal.is_some() || s.final_policy.is_some();
    if measured && (run.reward_quantity().as_deref() != Some("speed_m_s") || !walks) {
        tiles.push((
            format!("{} \u{2192} {}", reward(s.nominal), reward(s.final_policy)),
            "mean reward on the robot, nominal to final".to_owned(),
        ));
    }
    if measured && !walks {
        tiles.push((
            format!("{}\u{b0} \u{2192} {}\u{b0}", psi(s.nominal), psi(s.final_policy)),
            run.target_deg().map_or_else(
                || "mean ψ_roll, nominal to final".to_owned(),
                |t| format!("mean ψ_roll, nominal to final; desired {}\u{b0}", signed(t, 1)),
            ),
        ));
    }
    tiles.extend([
        (
            (s.strides.training + s.strides.evaluation).to_string(),
            format!(
                "strides on the robot: {} offered to the map, {} only to choose",
                s.strides.training, s.strides.evaluation
            ),
        ),
        (run.falls().0.to_string(), "falls on the robot while learning".to_owned()),
    ]);
    if s.improved == Some(false) {
        tiles.push((
            "not improved".to_owned(),
            "nothing learned beats the nominal gait, which is the final policy".to_owned(),
        ));
    }
    if let Some(push) = &run.push
        && let (Some(slope), Some(fixed)) = (push.slope, push.fixed_point_deg)
    {
        tiles.push((
            format!("{} at {}\u{b0}", signed(slope, 2), signed(fixed, 2)),
            "slope of the return map under pushes, and its fixed point".to_owned(),
        ));
    }
    if s.seconds.total > 0.0 {
        tiles.push((format!("{} s", number(s.seconds.total, 3)), "computing, simulation included".to_owned()));
    }
    let cells: String = tiles
        .iter()
        .map(|(value, what)| {
            format!("<div class=\"tile\"><b>{}</b><span>{}</span></div>", escape(value), subscripts(what))
        })
        .collect();
    format!("<div class=\"tiles\">{cells}</div>")
}

/// The runs of a page as a table.
pub(super) fn overview(runs: &[Run]) -> String {
    let walks = runs.iter().any(|r| {
        let measured = r.summary.as_ref().and_then(|s| s.final_policy);
        measured.is_some_and(|m| m.speed_m_s.is_some())
    });
    let pair = |m: Option<Measured>| -> [String; 2] {
        if walks {
            let value = |v: Option<f64>| v.map_or_else(|| "\u{2013}".to_owned(), |v| number(v, 3));
            [value(m.and_then(|m| m.speed_m_s)), value(m.and_then(|m| m.upright_s))]
        } else {
            [reward(m), psi(m)]
        }
    };
    let mut rows = String::new();
    for run in runs {
        let s = run.summary.clone().unwrap_or_default();
        let (falls, stalls) = run.falls();
        let ([a, b], [c, d]) = (pair(s.nominal), pair(s.final_policy));
        let cells: String = [run.transitions.len().to_string(), a, c, b, d, (falls + stalls).to_string()]
            .iter()
            .map(|cell| format!("<td class=\"num\">{cell}</td>"))
            .collect();
        rows.push_str(&format!(
            "<tr><td>{}</td>{cells}<td>{}</td></tr>",
            escape(&run.name),
            match (run.finished(), s.improved) {
                (true, Some(false)) => "finished: nothing learned beats the nominal gait",
                (true, _) => "finished",
                (false, _) => "did not reach its end",
            }
        ));
    }
    let names = if walks {
        ["nominal speed (m/s)", "final speed (m/s)", "nominal upright (s)", "final upright (s)"]
    } else {
        ["nominal reward", "final reward", "nominal ψ<sub>roll</sub> (deg)", "final ψ<sub>roll</sub> (deg)"]
    };
    let heads: String = ["strides"]
        .iter()
        .chain(&names)
        .chain(&["falls, stalls"])
        .map(|name| format!("<th class=\"num\">{name}</th>"))
        .collect();
    format!(
        "<div class=\"wide\"><table><thead><tr><th>run</th>{heads}<th></th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}

fn within(output: &SavedOutput, k: f64) -> Option<String> {
    let l = Some(&output.leave_one_out).filter(|l| !l.actual.is_empty())?;
    let inside = l.actual.iter().zip(&l.mean).zip(&l.std).filter(|((a, m), s)| (*a - *m).abs() <= k * *s).count();
    Some(format!("{inside} of {}", l.actual.len()))
}

/// The learned map's own account of itself, with its warnings.
pub(super) fn model_card(run: &Run) -> String {
    let Some(map) = run.maps.last() else {
        return String::new();
    };
    // A map may see the last action beside the action.
    let last = run.columns.action.iter();
    let last = last.map(|a| format!("last {}", plain(&label(a, ""))));
    let now = run.columns.state.iter().chain(&run.columns.action);
    let inputs: Vec<String> = now.map(|n| plain(&label(n, ""))).chain(last).collect();
    let mut rows = String::new();
    let mut warnings = String::new();
    for o in &map.outputs {
        let (name, unit) = quantity(&o.name);
        // The inputs on which the output depends most, shortest first.
        const SHOWN: usize = 4;
        let mut scales: Vec<(f64, &str)> = o
            .length_scales
            .iter()
            .copied()
            .zip(inputs.iter().map(String::as_str).chain(std::iter::repeat("")))
            .collect();
        scales.sort_by(|a, b| a.0.total_cmp(&b.0));
        let rest = scales.len().saturating_sub(SHOWN);
        let mut scales: Vec<String> =
            scales.iter().take(SHOWN).map(|(l, input)| format!("{} along {input}", number(*l, 3))).collect();
        if rest > 0 {
            scales.push(format!("longer along the other {rest}"));
        }
        let dash = || "\u{2013}".to_owned();
        rows.push_str(&format!(
            "<tr><td>{}</td><td>{}</td><td class=\"num\">{}</td><td class=\"num\">{}</td><td class=\"num\">{}</td>\
             <td class=\"num\">{}</td><td class=\"num\">{}</td></tr>",
            subscripts(&format!(
                "{}{}",
                plain(&name),
                if unit.is_empty() { String::new() } else { format!(" ({unit})") }
            )),
            subscripts(&scales.join("; ")),
            number(o.signal_variance.sqrt(), 3),
            number(o.noise_variance.sqrt(), 3),
            number(o.log_marginal_likelihood, 3),
            within(o, 1.0).unwrap_or_else(dash),
            within(o, 2.0).unwrap_or_else(dash)
        ));
        for w in plain_warnings(&o.warnings, &inputs) {
            warnings.push_str(&format!("<li class=\"bad\">{}: {}</li>", subscripts(&plain(&name)), subscripts(&w)));
        }
    }
    let warned = if warnings.is_empty() {
        "<p>The map's card warns of nothing.</p>".to_owned()
    } else {
        format!("<p>The map's card warns:</p><ul class=\"says\">{warnings}</ul>")
    };
    format!(
        "<div class=\"wide\"><table><thead><tr><th>output</th><th>length scales</th><th class=\"num\">signal sd</th>\
         <th class=\"num\">noise sd</th><th class=\"num\">log marginal likelihood</th><th class=\"num\">within ±1 sd (68 %)</th>\
         <th class=\"num\">within ±2 sd (95 %)</th></tr></thead><tbody>{rows}</tbody></table></div>\
         <p class=\"note\">Map of iteration {}. The last two columns: leave-one-out predictions.</p>{warned}",
        map.iteration
    )
}

/// The warnings of a card in the words of the task: inputs by their names, bounds by what they mean.
fn plain_warnings(warnings: &[String], inputs: &[String]) -> Vec<String> {
    let (mut unused, mut steep, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for w in warnings {
        let index = w
            .strip_prefix("length_scales[")
            .and_then(|rest| rest.split_once(']'))
            .and_then(|(i, rest)| Some((inputs.get(i.parse::<usize>().ok()?)?, rest)));
        match index {
            Some((input, rest)) if rest.ends_with("upper bound") => unused.push(input.as_str()),
            Some((input, rest)) if rest.ends_with("lower bound") => steep.push(input.as_str()),
            _ => others.push(w.clone()),
        }
    }
    if !unused.is_empty() {
        others.push(format!(
            "in these data it hardly depends, beside a straight line where the map has one, on {} (length scale at its upper bound)",
            unused.join(", ")
        ));
    }
    if !steep.is_empty() {
        others.push(format!(
            "it changes faster than the data can show along {} (length scale at its lower bound)",
            steep.join(", ")
        ));
    }
    others
}

/// Where a run comes from and how to make it again.
pub(super) fn provenance(run: &Run) -> String {
    let mut rows: Vec<(&str, String)> = Vec::new();
    if let Some(p) = &run.provenance {
        rows.push(("command", p.command.clone()));
        rows.push(("seed", p.seed.to_string()));
        rows.push(("Stridemap", p.version.clone()));
        rows.push(("source revision", p.git_revision.clone().unwrap_or_else(|| "not known".to_owned())));
        rows.push(("MuJoCo", p.mujoco_version.clone()));
        rows.push(("robot model", p.model_hash.clone()));
        rows.push(("machine", p.machine.clone()));
        rows.push(("start", p.start.clone()));
        rows.push(("end", p.end.clone().unwrap_or_else(|| "none: the run did not reach its end".to_owned())));
    }
    let (falls, stalls) = run.falls();
    let counts = run.summary.as_ref().map_or_else(
        || format!("{} so far", plural(run.transitions.len(), "stride")),
        |s| {
            format!(
                "{} training, {} evaluation, {} warm-up, {} only to report",
                s.strides.training, s.strides.evaluation, s.strides.warm_up, s.strides.record
            )
        },
    );
    rows.push(("strides on the robot", counts));
    rows.push(("while learning", format!("{}, {}", plural(falls, "fall"), plural(stalls, "stall"))));
    if let Some(seconds) = run.summary.as_ref().map(|s| s.seconds) {
        rows.push((
            "seconds of computing",
            format!(
                "{} in all: {} simulating, {} fitting, {} improving",
                number(seconds.total, 3),
                number(seconds.by_work.simulation, 3),
                number(seconds.by_work.fit, 2),
                number(seconds.by_work.improve, 3)
            ),
        ));
    }
    let table: String = rows
        .iter()
        .filter(|r| !r.1.is_empty())
        .map(|(what, value)| {
            let value = if *what == "command" { format!("<code>{}</code>", escape(value)) } else { escape(value) };
            format!("<tr><th scope=\"row\">{what}</th><td>{value}</td></tr>")
        })
        .collect();
    let proofs = proofs(run);
    let config = run.config.as_ref().map_or_else(String::new, |text| {
        format!(
            "<details><summary>Configuration, every value as resolved</summary><pre>{}</pre></details>",
            escape(text)
        )
    });
    format!("<div class=\"wide\"><table class=\"facts\"><tbody>{table}</tbody></table></div>{proofs}{config}")
}

/// The policies that were tried on the robot before they were trusted, as a table.
fn proofs(run: &Run) -> String {
    let Some(s) = &run.summary else {
        return String::new();
    };
    let rows: String = s
        .iterations
        .iter()
        .filter_map(|i| Some((i, i.proof.as_ref()?)))
        .map(|(i, p)| {
            let chosen = s.final_iteration == Some(i.iteration);
            let warnings: Vec<&str> = i
                .warnings
                .iter()
                .map(|w| crate::figures::warning_words(w.warning))
                .collect();
            let mut kinds = warnings.clone();
            kinds.sort_unstable();
            kinds.dedup();
            let action: Vec<String> = p.action.iter().map(|u| signed(*u, 2)).collect();
            format!(
                "<tr><td class=\"num\">{}</td><td class=\"num\">{}</td><td class=\"num\">{}</td><td>{}{}</td><td>{}</td>\
                 <td>{}</td></tr>",
                i.iteration,
                i.strides,
                number(p.speed_m_s, 3),
                crate::figures::verdict_words(p.verdict),
                if chosen { ", <b>final</b>" } else { "" },
                escape(&if warnings.is_empty() {
                    "\u{2013}".to_owned()
                } else {
                    format!("{}: {}", warnings.len(), kinds.join("; "))
                }),
                escape(&action.join(", "))
            )
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let names: Vec<String> = run.columns.action.iter().map(|a| plain(&label(a, ""))).collect();
    format!(
        "<details><summary>Policies tried on the robot</summary><div class=\"wide\"><table><thead><tr><th class=\"num\">iteration</th>\
         <th class=\"num\">strides</th><th class=\"num\">speed in the proof (m/s)</th><th>what became of it</th><th>warnings</th>\
         <th>mean action</th></tr></thead><tbody>{rows}</tbody></table></div><p class=\"note\">Mean action: {}. Strides of the first \
         iteration include the exploration.</p></details>",
        subscripts(&names.join(", "))
    )
}

/// The paper and this software.
pub(super) fn bibliography(runs: &[Run]) -> String {
    let made = runs.iter().find_map(|r| r.provenance.as_ref());
    let version = made.map_or("", |p| p.version.as_str());
    let year = made.and_then(|p| p.start.get(..4)).unwrap_or("2026");
    let model = made.map_or("", |p| p.model_hash.as_str());
    let revision = made.and_then(|p| p.git_revision.as_deref());
    let mut note = Vec::new();
    if let Some(revision) = revision {
        note.push(format!("revision {revision}"));
    }
    if !model.is_empty() {
        note.push(format!("robot model {model}"));
    }
    let entry = format!(
        "@article{{morimoto2009nonparametric,\n  author  = {{Morimoto, Jun and Atkeson, Christopher G.}},\n  title   = \
         {{Nonparametric representation of an approximated {{P}}oincar\u{e9} map for learning biped locomotion}},\n  journal = \
         {{Autonomous Robots}},\n  year    = {{2009}},\n  doi     = {{10.1007/s10514-009-9133-z}}\n}}\n\n@software{{stridemap,\n  \
         title   = {{Stridemap: improves an existing walking controller from a few dozen real steps}},\n  version = {{{version}}},\n  \
         author  = {{{{The Stridemap developers}}}},\n  year    = {{{year}}},\n  note    = {{{}}}\n}}",
        note.join("; ")
    );
    format!(
        "<h3>To cite</h3><p>J. Morimoto and C. G. Atkeson, <em>Nonparametric representation of an approximated Poincaré map for learning \
         biped locomotion</em>, Autonomous Robots, 2009, \
         <a href=\"https://doi.org/10.1007/s10514-009-9133-z\">doi:10.1007/s10514-009-9133-z</a>; and the version of Stridemap \
         that made the numbers.</p><pre tabindex=\"0\" aria-label=\"BibTeX entries\">{}</pre>",
        escape(&entry)
    )
}

#[cfg(test)]
mod tests {
    use super::plain_warnings;

    #[test]
    fn warnings_name_inputs_and_say_what_bounds_mean() {
        let inputs = ["psi (deg)".to_owned(), "lean (deg)".to_owned()];
        let warnings = [
            "9 points repeat an earlier one",
            "length_scales[1] = 7.269e2 is at its upper bound",
            "length_scales[7] = 1 is at its upper bound",
        ];
        let said = plain_warnings(&warnings.map(str::to_owned), &inputs);
        assert_eq!(said[0], "9 points repeat an earlier one");
        assert_eq!(said[1], "length_scales[7] = 1 is at its upper bound");
        assert!(said[2].contains("hardly depends") && said[2].contains("on lean (deg) (length"), "{}", said[2]);
    }
}
