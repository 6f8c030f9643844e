//! The words and tables of a page: what happened, in numbers and plain sentences.

use super::html::{self, subscripts};
use crate::draw::{N, escape, number, plain, plural, signed, times};
use crate::figures::{label, mean_reward, measured, verdict_words, warning_words};
use stridemap_process::StrideEnd;
use stridemap_record::{IterationSummary, Measured, Proof, Run, StrideCounts, Verdict};

/// Title of the page of one run.
pub(super) fn title(run: &Run) -> String {
    match (&run.summary, &run.provenance) {
        (Some(s), _) if !s.experiment.is_empty() => format!("{}, seed {}", s.experiment, s.seed),
        (_, Some(p)) => format!("{}, seed {}", run.name, p.seed),
        _ => run.name.clone(),
    }
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
    let mut says = Vec::new();
    says.extend(early_end(run));
    falls(run, &mut says);
    caution(run, &mut says);
    match run.transitions.len() {
        0 => says.push((true, "This run has no stride yet.".to_owned())),
        1 => says.push((true, "This run has one stride. A spread, a map or a trend cannot be had from it.".to_owned())),
        _ => {}
    }
    says.extend(run.problems.iter().map(|problem| (true, format!("Could not be read: {problem}."))));
    if !run.missing.is_empty() {
        says.push((true, format!("Not in the run directory: {}.", run.missing.join(", "))));
    }
    html::says(&says)
}

/// That a run did not reach its end, and why.
fn early_end(run: &Run) -> Option<(bool, String)> {
    let last = run.transitions.last().map_or(0, |t| t.iteration);
    let why = match &run.stopped {
        // To the second.
        Some(stop) => {
            let (time, reason) = (stop.time.split('.').next().unwrap_or_default(), stop.reason.trim_end_matches('.'));
            format!("it stopped at {time}: {reason}.")
        }
        None => "it was killed, or it is still going.".to_owned(),
    };
    let made = plural(run.transitions.len(), "stride");
    let text = format!(
        "This run did not reach its end: {why} It left {made} on the robot, the last of them in iteration {last}. \
         Everything below is what it had written by then."
    );
    (!run.finished()).then_some((true, text))
}

/// How often the robot fell, stalled or was stopped, while learning and when measured.
fn falls(run: &Run, says: &mut Vec<(bool, String)>) {
    const SHOWN: usize = 8;
    for (end, what) in [
        (StrideEnd::Fell, "fell"),
        (StrideEnd::NoCrossing, "stalled"),
        (StrideEnd::Aborted, "was stopped by its equipment"),
    ] {
        let strides = run.transitions.iter().enumerate().filter(|(_, t)| t.end == end);
        let strides: Vec<String> =
            strides.map(|(i, t)| format!("stride {} (iteration {})", i + 1, t.iteration)).collect();
        if !strides.is_empty() {
            let shown = strides[..strides.len().min(SHOWN)].join(", ");
            let more = if strides.len() > SHOWN { ", and more" } else { "" };
            says.push((true, format!("The robot {what} {} while learning: {shown}{more}.", times(strides.len()))));
        }
    }
    if run.finished() && run.falls() == (0, 0) {
        says.push((false, "The robot did not fall while learning.".to_owned()));
    }
    for (name, m) in ["nominal gait", "final policy"].into_iter().zip(measured(run)) {
        if let Some(m) = m.map(|m| m.performance).filter(|m| m.falls > 0 || m.stalls > 0) {
            let [falls, stalls, strides] =
                [(m.falls, "fall"), (m.stalls, "stall"), (m.strides, "stride")].map(|(n, noun)| plural(n, noun));
            let text = format!("Measured apart from learning, the {name} had {falls} and {stalls} in {strides}.");
            says.push((true, text));
        }
    }
}

/// What the guard and the proofs said.
fn caution(run: &Run, says: &mut Vec<(bool, String)>) {
    let Some(s) = &run.summary else { return };
    let verdicts = || s.iterations.iter().map(|i| i.proof.as_ref().map(|p| p.verdict));
    let warned: usize = s.iterations.iter().map(|i| i.warnings.len()).sum();
    if warned > 0 {
        let back = match verdicts().filter(|v| *v == Some(Verdict::Warned)).count() {
            0 => "no policy was".to_owned(),
            1 => "one policy was".to_owned(),
            n => format!("{n} policies were"),
        };
        says.push((false, format!("The guard warned {} while learning; {back} turned back by it.", times(warned))));
    }
    if !s.iterations.is_empty() && verdicts().all(|v| v.is_some_and(|v| v != Verdict::Proven)) {
        says.push((true, "No policy was proven on the robot.".to_owned()));
    }
}

/// Mean reward, or a dash.
fn reward(m: Option<Measured>) -> String {
    number(mean_reward(m).unwrap_or(f64::NAN), 3)
}

/// Mean psi_roll in degrees, or a dash.
fn psi(m: Option<Measured>) -> String {
    signed(m.and_then(|m| m.performance.mean_psi_roll_deg).unwrap_or(f64::NAN), 2)
}

/// The numbers of one run that one looks for first.
pub(super) fn tiles(run: &Run) -> String {
    let Some(s) = &run.summary else {
        return String::new();
    };
    let mut tiles: Vec<(String, String)> = Vec::new();
    let mut tile = |value: String, what: &str| tiles.push((value, what.to_owned()));
    let (nominal, last) = (s.nominal, s.final_policy);
    let speed = |m: Option<Measured>| number(m.and_then(|m| m.speed_m_s).unwrap_or(f64::NAN), 3);
    let walks = last.or(nominal).is_some_and(|m| m.speed_m_s.is_some());
    if walks {
        let value = format!("{} \u{2192} {} m/s", speed(nominal), speed(last));
        tile(value, "speed along the first heading, nominal to final");
        if let Some(upright) = last.and_then(|m| m.upright_s) {
            let drift = last.and_then(|m| m.drift_m);
            let drift = drift.map_or_else(String::new, |d| format!("; {:.2} m to the left of the first heading", N(d)));
            tile(format!("{:#.3} s", N(upright)), &format!("the final policy walked without a fall, up to 60{drift}"));
        }
    }
    let measured = nominal.is_some() || last.is_some();
    if measured && (run.reward_quantity().as_deref() != Some("speed_m_s") || !walks) {
        let value = format!("{} \u{2192} {}", reward(nominal), reward(last));
        tile(value, "mean reward on the robot, nominal to final");
    }
    if measured && !walks {
        let desired = run.target_deg().map_or_else(String::new, |t| format!("; desired {:.1}\u{b0}", N(t)));
        let value = format!("{}\u{b0} \u{2192} {}\u{b0}", psi(nominal), psi(last));
        tile(value, &format!("mean ψ_roll, nominal to final{desired}"));
    }
    let (training, evaluation) = (s.strides.training, s.strides.evaluation);
    let split = format!("strides on the robot: {training} offered to the map, {evaluation} only to choose");
    tile((training + evaluation).to_string(), &split);
    tile(run.falls().0.to_string(), "falls on the robot while learning");
    if s.improved == Some(false) {
        tile("not improved".to_owned(), "nothing learned beats the nominal gait, which is the final policy");
    }
    if let Some((slope, fixed)) = run.push.as_ref().and_then(|push| push.slope.zip(push.fixed_point_deg)) {
        let value = format!("{:.2} at {:.2}\u{b0}", N(slope), N(fixed));
        tile(value, "slope of the return map under pushes, and its fixed point");
    }
    if s.seconds.total > 0.0 {
        tile(format!("{:#.3} s", N(s.seconds.total)), "computing, simulation included");
    }
    let cell = |(value, what): &(String, String)| {
        format!("<div class=\"tile\"><b>{}</b><span>{}</span></div>", escape(value), subscripts(what))
    };
    format!("<div class=\"tiles\">{}</div>", tiles.iter().map(cell).collect::<String>())
}

/// The runs of a page as a table.
pub(super) fn overview(runs: &[Run]) -> String {
    let walks = runs.iter().any(|run| measured(run)[1].is_some_and(|m| m.speed_m_s.is_some()));
    let value = |v: Option<f64>| number(v.unwrap_or(f64::NAN), 3);
    let pair = |m: Option<Measured>| match walks {
        true => [value(m.and_then(|m| m.speed_m_s)), value(m.and_then(|m| m.upright_s))],
        false => [reward(m), psi(m)],
    };
    let names = match walks {
        true => ["nominal speed (m/s)", "final speed (m/s)", "nominal upright (s)", "final upright (s)"],
        false => ["nominal reward", "final reward", "nominal ψ<sub>roll</sub> (deg)", "final ψ<sub>roll</sub> (deg)"],
    };
    let numbers = ["strides"].into_iter().chain(names).chain(["falls, stalls"]).map(|name| (name, true));
    let columns: Vec<_> = [("run", false)].into_iter().chain(numbers).chain([("", false)]).collect();
    let row = |run: &Run| {
        let (falls, stalls) = run.falls();
        let [[a, b], [c, d]] = measured(run).map(pair);
        let how = match (run.finished(), run.summary.as_ref().and_then(|s| s.improved)) {
            (true, Some(false)) => "finished: nothing learned beats the nominal gait",
            (true, _) => "finished",
            (false, _) => "did not reach its end",
        };
        let strides = run.transitions.len().to_string();
        vec![escape(&run.name), strides, a, c, b, d, (falls + stalls).to_string(), how.to_owned()]
    };
    html::table(&columns, &runs.iter().map(row).collect::<Vec<_>>())
}

/// Where a run comes from and how to make it again.
pub(super) fn provenance(run: &Run) -> String {
    let mut rows: Vec<(&str, String)> = Vec::new();
    if let Some(p) = run.provenance.clone() {
        rows.extend([
            ("command", p.command),
            ("seed", p.seed.to_string()),
            ("Stridemap", p.version),
            ("source revision", p.git_revision.unwrap_or_else(|| "not known".to_owned())),
            ("MuJoCo", p.mujoco_version),
            ("robot model", p.model_hash),
            ("machine", p.machine),
            ("start", p.start),
            ("end", p.end.unwrap_or_else(|| "none: the run did not reach its end".to_owned())),
        ]);
    }
    let (falls, stalls) = run.falls();
    let counts = match run.summary.as_ref().map(|s| s.strides) {
        None => format!("{} so far", plural(run.transitions.len(), "stride")),
        Some(StrideCounts { training, evaluation, warm_up, record }) => {
            format!("{training} training, {evaluation} evaluation, {warm_up} warm-up, {record} only to report")
        }
    };
    rows.push(("strides on the robot", counts));
    rows.push(("while learning", format!("{}, {}", plural(falls, "fall"), plural(stalls, "stall"))));
    if let Some(s) = run.summary.as_ref().map(|s| s.seconds) {
        let [all, simulation, fit, improve] = [s.total, s.by_work.simulation, s.by_work.fit, s.by_work.improve].map(N);
        let split = format!("{simulation:#.3} simulating, {fit:#.2} fitting, {improve:#.3} improving");
        rows.push(("seconds of computing", format!("{all:#.3} in all: {split}")));
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
    let tried = s.iterations.iter().filter_map(|i| Some((i, i.proof.as_ref()?)));
    let row = |(i, p): (&IterationSummary, &Proof)| {
        let mut kinds: Vec<&str> = i.warnings.iter().map(|w| warning_words(w.warning)).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let warnings = match i.warnings.len() {
            0 => "\u{2013}".to_owned(),
            n => format!("{n}: {}", kinds.join("; ")),
        };
        let chosen = if s.final_iteration == Some(i.iteration) { ", <b>final</b>" } else { "" };
        let action: Vec<String> = p.action.iter().map(|u| signed(*u, 2)).collect();
        let numbers = [i.iteration.to_string(), i.strides.to_string(), number(p.speed_m_s, 3)];
        let words = [format!("{}{chosen}", verdict_words(p.verdict)), escape(&warnings), action.join(", ")];
        numbers.into_iter().chain(words).collect()
    };
    let rows: Vec<Vec<String>> = tried.map(row).collect();
    if rows.is_empty() {
        return String::new();
    }
    let columns = [
        ("iteration", true),
        ("strides", true),
        ("speed in the proof (m/s)", true),
        ("what became of it", false),
        ("warnings", false),
        ("mean action", false),
    ];
    let names: Vec<String> = run.columns.action.iter().map(|a| plain(&label(a, ""))).collect();
    format!(
        "<details><summary>Policies tried on the robot</summary>{}<p class=\"note\">Mean action: {}. Strides of the first \
         iteration include the exploration.</p></details>",
        html::table(&columns, &rows),
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
