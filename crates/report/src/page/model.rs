//! The learned map's own account of itself, with its warnings.

use super::html::{says, subscripts, table};
use crate::draw::{N, plain};
use crate::figures::{label, quantity};
use stridemap_map::SavedOutput;
use stridemap_record::Run;

/// How many outcomes lie within `k` standard deviations of what was predicted from the others.
fn within(output: &SavedOutput, k: f64) -> String {
    let l = &output.leave_one_out;
    let inside = l.actual.iter().zip(&l.mean).zip(&l.std).filter(|((a, m), s)| (*a - *m).abs() <= k * *s).count();
    if l.actual.is_empty() { "\u{2013}".to_owned() } else { format!("{inside} of {}", l.actual.len()) }
}

/// The inputs on which an output depends most, shortest length scale first.
fn length_scales(output: &SavedOutput, inputs: &[String]) -> String {
    const SHOWN: usize = 4;
    let names = inputs.iter().map(String::as_str).chain(std::iter::repeat(""));
    let mut scales: Vec<(f64, &str)> = output.length_scales.iter().copied().zip(names).collect();
    scales.sort_by(|a, b| a.0.total_cmp(&b.0));
    let shown = scales.iter().take(SHOWN).map(|(l, input)| format!("{:#.3} along {input}", N(*l)));
    let rest = scales.len().checked_sub(SHOWN + 1).map(|rest| format!("longer along the other {}", rest + 1));
    shown.chain(rest).collect::<Vec<_>>().join("; ")
}

/// The learned map's own account of itself.
pub(super) fn card(run: &Run) -> String {
    let Some(map) = run.maps.last() else {
        return String::new();
    };
    // A map may see the last action beside the action.
    let last = run.columns.action.iter().map(|a| format!("last {}", plain(&label(a, ""))));
    let now = run.columns.state.iter().chain(&run.columns.action);
    let inputs: Vec<String> = now.map(|n| plain(&label(n, ""))).chain(last).collect();
    let columns = [
        ("output", false),
        ("length scales", false),
        ("signal sd", true),
        ("noise sd", true),
        ("log marginal likelihood", true),
        ("within ±1 sd (68 %)", true),
        ("within ±2 sd (95 %)", true),
    ];
    let row = |o: &SavedOutput| {
        let numbers = [o.signal_variance.sqrt(), o.noise_variance.sqrt(), o.log_marginal_likelihood];
        let words = [subscripts(&plain(&label(&o.name, ""))), subscripts(&length_scales(o, &inputs))];
        let numbers = numbers.map(|v| format!("{:#.3}", N(v)));
        words.into_iter().chain(numbers).chain([within(o, 1.0), within(o, 2.0)]).collect()
    };
    let rows: Vec<Vec<String>> = map.outputs.iter().map(row).collect();
    let warn = |o: &SavedOutput| {
        let name = plain(&quantity(&o.name).0);
        let warnings = plain_warnings(&o.warnings, &inputs).into_iter();
        warnings.map(|w| (true, format!("{name}: {w}"))).collect::<Vec<_>>()
    };
    let warnings: Vec<(bool, String)> = map.outputs.iter().flat_map(warn).collect();
    let warned = if warnings.is_empty() { "The map's card warns of nothing." } else { "The map's card warns:" };
    format!(
        "{}<p class=\"note\">Map of iteration {}. The last two columns: leave-one-out predictions.</p><p>{warned}</p>{}",
        table(&columns, &rows),
        map.iteration,
        says(&warnings)
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
