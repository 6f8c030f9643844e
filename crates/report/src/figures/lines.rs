//! What a map says about small changes of a policy: cuts along its inputs through the policy.

use super::check::{column, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, Sheet, extent, number, plain, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::LineGrid;
use stridemap_record::{Columns, Region, Transition};

/// Cuts through a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineFigure {
    /// Iteration whose map is drawn.
    pub iteration: usize,
    /// Names of state and action.
    pub columns: Columns,
    /// The map along its inputs.
    pub grid: LineGrid,
    /// The training strides from which it was learned.
    pub strides: Vec<Transition>,
    /// Where the policy was allowed to lie.
    pub region: Option<Region>,
    /// What the reward is, if it is a single quantity: `speed_m_s`.
    pub reward: Option<String>,
}

/// Where the output of interest stands: the reward where it has a map of its own, else the first state.
fn shown(grid: &LineGrid) -> usize {
    let reward = grid.outputs.iter().position(|o| o.name == "reward");
    reward.unwrap_or(0)
}

/// Draws the map along each action through the policy (and along the state where there is one of each):
/// predicted mean, two standard deviations, where the data are, the policy's own place, and its trust
/// region.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if the lines are empty or hold a value that is not finite.
pub fn map_lines(data: &LineFigure) -> Result<Figure> {
    let stem = "map-lines";
    let g = &data.grid;
    let n = g.along.len();
    some(stem, "no row of the map", n)?;
    some(stem, "no output", g.outputs.len())?;
    let names: Vec<&String> = data.columns.state.iter().chain(&data.columns.action).collect();
    for (values, name) in g.inputs.iter().zip(&names) {
        column(stem, name, values, n)?;
    }
    let output = &g.outputs[shown(g)];
    for (values, what) in [(&output.mean, "mean"), (&output.latent_std, "latent_std"), (&output.noise_std, "noise_std")]
    {
        column(stem, &format!("{what} {}", output.name), values, n)?;
    }
    let own = output.name == "reward";
    let name = match &data.reward {
        Some(reward) if own => label(reward, ""),
        _ if own => "reward".to_owned(),
        _ => label(&output.name, "(k + 1)"),
    };
    let states = data.columns.state.len();
    let drawn: Vec<usize> = (0..g.inputs.len().min(names.len())).filter(|i| *i >= states || names.len() == 2).collect();
    let spread = |i: usize, k: f64| output.mean[i] + k * output.latent_std[i].hypot(output.noise_std[i]);
    let (lo, hi) = extent((0..n).filter(|i| drawn.contains(&g.along[*i])).flat_map(|i| {
        // A band that runs away from the data would press the curves flat.
        [output.mean[i] - 2.5 * output.noise_std[i], output.mean[i] + 2.5 * output.noise_std[i]]
    }));
    let air = 0.12 * (hi - lo);
    let per_row = drawn.len().clamp(1, 3);
    let mut sheet = Sheet::new(stem, "The map about the policy");
    let mut csv = format!(
        "along,{},mean_{out},latent_std_{out},noise_std_{out}\n",
        names.iter().map(|n| n.as_str()).collect::<Vec<_>>().join(","),
        out = output.name
    );
    let mut place = Vec::new();
    for chunk in drawn.chunks(per_row) {
        let specs = chunk
            .iter()
            .enumerate()
            .map(|(slot, input)| {
                let rows = line(g, *input);
                let (x0, x1) = extent(rows.iter().map(|i| g.inputs[*input][*i]));
                let most = if per_row > 2 { 5.0 } else { 6.0 };
                let x = Axis::linear_with(&label(names[*input], ""), x0, x1, most);
                let text = if slot == 0 { name.as_str() } else { "" };
                (1.0, x, Axis::linear_with(text, lo - air, hi + air, 5.0), None)
            })
            .collect();
        let height = if per_row > 2 { 130.0 } else { 220.0 };
        for (input, mut p) in chunk.iter().zip(sheet.row(height, specs)) {
            let rows = line(g, *input);
            let x: Vec<f64> = rows.iter().map(|i| g.inputs[*input][*i]).collect();
            let edge = |k: f64| rows.iter().map(|i| spread(*i, k)).collect::<Vec<f64>>();
            if let Some(region) = data.region.as_ref().filter(|_| *input >= states)
                && let (Some(a), Some(b)) = (region.lower.get(input - states), region.upper.get(input - states))
            {
                p.band(&[*a, *b], &[p.y.min; 2], &[p.y.max; 2], "s4", 0.16);
                p.key("trust region", Key::Band("s4", 0.2));
            }
            p.band(&x, &edge(-2.0), &edge(2.0), "s0", 0.2);
            let mean: Vec<(f64, f64)> = x.iter().copied().zip(edge(0.0)).collect();
            p.line(&mean, "s0", Dash::Solid, 2.2);
            let visited: Vec<f64> = data
                .strides
                .iter()
                .filter_map(|s| {
                    let from_action = || s.action.get(input.wrapping_sub(states));
                    s.state.get(*input).filter(|_| *input < states).or_else(from_action)
                })
                .copied()
                .collect();
            p.rug(&visited, "s6", 0);
            // Where the other lines cross this one.
            if let Some(at) = (0..n).find(|i| g.along[*i] != *input) {
                let here = g.inputs[*input][at];
                p.upward(here, "s2", Dash::Dashed);
                p.key("the policy", Key::Line("s2", Dash::Dashed));
                let nearest = mean.iter().min_by(|a, b| (a.0 - here).abs().total_cmp(&(b.0 - here).abs()));
                if let Some(q) = nearest {
                    p.marks(&[(here, q.1)], "s2", Mark::Disc, 4.2);
                }
                let (quantity, unit) = quantity(names[*input]);
                place.push(format!("{} {} {unit}", plain(&quantity), signed(here, 2)));
            }
            for i in (0..rows.len()).step_by((rows.len() / 30).max(1)) {
                p.hover(
                    x[i],
                    mean[i].1,
                    format!(
                        "{} = {}: {} ± {}",
                        quantity(names[*input]).0,
                        signed(x[i], 2),
                        number(mean[i].1, 3),
                        number(spread(rows[i], 1.0) - mean[i].1, 2)
                    ),
                );
            }
            p.key("mean", Key::Line("s0", Dash::Solid));
            p.key("± 2 sd (function and noise)", Key::Band("s0", 0.2));
            sheet.add(p);
        }
    }
    for (i, along) in g.along.iter().enumerate() {
        csv.push_str(&along.to_string());
        for c in &g.inputs {
            csv.push_str(&format!(",{}", c[i]));
        }
        csv.push_str(&format!(",{},{},{}\n", output.mean[i], output.latent_std[i], output.noise_std[i]));
    }
    let caption = format!(
        "Map of iteration {}: prediction of {} along each {}, everything else held where the map settles under the policy found \
         in it (uprights: {}). Line: mean; band: ±2 standard deviations, noise included. Ticks along the bottom: n = {} strides from \
         which the map was learned; they lie anywhere in the other directions.{}",
        data.iteration,
        plain(&name),
        if names.len() == 2 { "input" } else { "action" },
        place.join(", "),
        data.strides.len(),
        if data.region.is_some() { " Shaded: where the policy was allowed to lie." } else { "" }
    );
    let alt = format!(
        "Cuts through the learned map: {} along {} inputs, with bands of two standard deviations.",
        plain(&name),
        drawn.len()
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

fn line(grid: &LineGrid, along: usize) -> Vec<usize> {
    (0..grid.along.len()).filter(|i| grid.along[*i] == along).collect()
}
