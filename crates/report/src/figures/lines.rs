//! What a map says about small changes of a policy: cuts along its inputs through the policy.

use super::check::{column, present};
use super::names::{label, quantity};
use super::of_run::{final_or_last, iterations, map_strides};
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, extent, pairs, plain};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::{LineGrid, LineOutput};
use stridemap_record::{Region, Run, Transition};

/// A map along its inputs, and what belongs to it.
struct Cuts<'a> {
    grid: &'a LineGrid,
    /// State, then action.
    names: Vec<&'a str>,
    states: usize,
    /// The reward where it has a map of its own, else the first state.
    output: &'a LineOutput,
    /// The training strides from which the map was learned.
    strides: Vec<&'a Transition>,
    /// Where the policy was allowed to lie.
    region: Option<&'a Region>,
}

impl Cuts<'_> {
    /// Rows of the grid that belong to the line along an input.
    fn rows(&self, along: usize) -> Vec<usize> {
        (0..self.grid.along.len()).filter(|i| self.grid.along[*i] == along).collect()
    }

    /// Mean and `k` standard deviations, function and noise.
    fn spread(&self, i: usize, k: f64) -> f64 {
        self.output.mean[i] + k * self.output.latent_std[i].hypot(self.output.noise_std[i])
    }

    /// Where the other lines cross the one along an input: the policy's place.
    fn policy_at(&self, input: usize) -> Option<f64> {
        let other = self.grid.along.iter().position(|along| *along != input)?;
        Some(self.grid.inputs[input][other])
    }

    fn draw(&self, p: &mut Panel, input: usize) {
        let rows = self.rows(input);
        let x: Vec<f64> = rows.iter().map(|i| self.grid.inputs[input][*i]).collect();
        let edge = |k: f64| rows.iter().map(|i| self.spread(*i, k)).collect::<Vec<f64>>();
        if let Some(region) = self.region.filter(|_| input >= self.states)
            && let (Some(a), Some(b)) = (region.lower.get(input - self.states), region.upper.get(input - self.states))
        {
            p.band(&[*a, *b], &[p.y.min; 2], &[p.y.max; 2], "s4", 0.16);
            p.key("trust region", Key::Band("s4", 0.2));
        }
        p.band(&x, &edge(-2.0), &edge(2.0), "s0", 0.2);
        let mean = pairs(&x, &edge(0.0));
        p.line(&mean, "s0", Dash::Solid, 2.2);
        let visited = self.strides.iter().filter_map(|s| match input.checked_sub(self.states) {
            Some(action) => s.action.get(action),
            None => s.state.get(input),
        });
        p.rug(&visited.copied().collect::<Vec<_>>(), "s6", 0);
        if let Some(here) = self.policy_at(input) {
            p.upward(here, "s2", Dash::Dashed);
            p.key("the policy", Key::Line("s2", Dash::Dashed));
            let nearest = mean.iter().min_by(|a, b| (a.0 - here).abs().total_cmp(&(b.0 - here).abs()));
            if let Some(q) = nearest {
                p.marks(&[(here, q.1)], "s2", Mark::Disc, 4.2);
            }
        }
        let name = quantity(self.names[input]).0;
        for (row, (x, y)) in rows.iter().zip(&mean).step_by((rows.len() / 30).max(1)) {
            let [at, mean, sd] = [*x, *y, self.spread(*row, 1.0) - y].map(N);
            p.hover(*x, *y, format!("{name} = {at:.2}: {mean:#.3} ± {sd:#.2}"));
        }
        p.key("mean", Key::Line("s0", Dash::Solid));
        p.key("± 2 sd (function and noise)", Key::Band("s0", 0.2));
    }

    fn csv(&self) -> String {
        let (g, o) = (self.grid, self.output);
        let mut csv =
            format!("along,{},mean_{out},latent_std_{out},noise_std_{out}\n", self.names.join(","), out = o.name);
        for (i, along) in g.along.iter().enumerate() {
            csv += &along.to_string();
            g.inputs.iter().for_each(|c| csv += &format!(",{}", c[i]));
            csv += &format!(",{},{},{}\n", o.mean[i], o.latent_std[i], o.noise_std[i]);
        }
        csv
    }
}

/// Draws the map along each action through the policy (and along the state where there is one of each):
/// predicted mean, two standard deviations, where the data are, the policy's own place, and its trust
/// region. Of the final policy's map, or of the last.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there are no lines, or they hold a value that is not finite.
pub fn map_lines(run: &Run) -> Result<Figure> {
    let stem = "map-lines";
    let lines = final_or_last(run, &run.lines).filter(|(_, g)| !g.along.is_empty() && !g.outputs.is_empty());
    let (iteration, grid) = present(stem, "the run has no map along its inputs", lines)?;
    let n = grid.along.len();
    let cuts = Cuts {
        grid,
        names: run.columns.state.iter().chain(&run.columns.action).map(String::as_str).collect(),
        states: run.columns.state.len(),
        output: grid.outputs.iter().find(|o| o.name == "reward").unwrap_or(&grid.outputs[0]),
        strides: map_strides(run, *iteration),
        region: iterations(run).iter().find(|i| i.iteration == *iteration).and_then(|i| i.trust_region.as_ref()),
    };
    let (names, output) = (&cuts.names, cuts.output);
    for (values, name) in grid.inputs.iter().zip(names) {
        column(stem, name, values, n)?;
    }
    for (values, what) in [(&output.mean, "mean"), (&output.latent_std, "latent_std"), (&output.noise_std, "noise_std")]
    {
        column(stem, &format!("{what} {}", output.name), values, n)?;
    }
    let name = match run.reward_quantity() {
        Some(reward) if output.name == "reward" => label(&reward, ""),
        _ if output.name == "reward" => "reward".to_owned(),
        _ => label(&output.name, "(k + 1)"),
    };
    let inputs = 0..grid.inputs.len().min(names.len());
    let drawn: Vec<usize> = inputs.filter(|i| *i >= cuts.states || names.len() == 2).collect();
    let (lo, hi) = extent((0..n).filter(|i| drawn.contains(&grid.along[*i])).flat_map(|i| {
        // A band that runs away from the data would press the curves flat.
        [output.mean[i] - 2.5 * output.noise_std[i], output.mean[i] + 2.5 * output.noise_std[i]]
    }));
    let air = 0.12 * (hi - lo);
    let per_row = drawn.len().clamp(1, 3);
    let (height, most) = if per_row > 2 { (130.0, 5.0) } else { (220.0, 6.0) };
    let mut sheet = Sheet::new(stem, "The map about the policy");
    for chunk in drawn.chunks(per_row) {
        let spec = |(slot, input): (usize, &usize)| {
            let (x0, x1) = extent(cuts.rows(*input).iter().map(|i| grid.inputs[*input][*i]));
            let x = Axis::linear_with(&label(names[*input], ""), x0, x1, most);
            let text = if slot == 0 { name.as_str() } else { "" };
            (1.0, x, Axis::linear_with(text, lo - air, hi + air, 5.0), None)
        };
        for (input, mut p) in chunk.iter().zip(sheet.row(height, chunk.iter().enumerate().map(spec).collect())) {
            cuts.draw(&mut p, *input);
            sheet.add(p);
        }
    }
    let place = |input: &usize| {
        let (quantity, unit) = quantity(names[*input]);
        Some(format!("{} {:.2} {unit}", plain(&quantity), N(cuts.policy_at(*input)?)))
    };
    let (name, along) = (plain(&name), if names.len() == 2 { "input" } else { "action" });
    let place = drawn.iter().filter_map(place).collect::<Vec<_>>().join(", ");
    let (strides, inputs) = (cuts.strides.len(), drawn.len());
    let shaded = cuts.region.map_or("", |_| " Shaded: where the policy was allowed to lie.");
    let caption = format!(
        "Map of iteration {iteration}: prediction of {name} along each {along}, everything else held where the map settles under \
         the policy found in it (uprights: {place}). Line: mean; band: ±2 standard deviations, noise included. Ticks along the \
         bottom: n = {strides} strides from which the map was learned; they lie anywhere in the other directions.{shaded}"
    );
    let alt =
        format!("Cuts through the learned map: {name} along {inputs} inputs, with bands of two standard deviations.");
    Ok(sheet.finish(&caption, &alt, cuts.csv()))
}
