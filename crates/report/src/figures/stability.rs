//! Will it fall? Return map, multipliers, checks of residuals and survival, of an analysis of strides.

use super::check::{column, present, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, plain};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_stability::{Estimate, Examined, Method};

/// Most panels in a row.
const PER_ROW: usize = 3;

/// Draws what an analysis found: return map, multipliers in the unit circle with their intervals, checks of residuals,
/// and the survival curve where there is one.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if a value is not finite.
pub fn stability(examined: &Examined) -> Result<Vec<Figure>> {
    let mut figures = vec![return_map(examined)?, residual_checks(examined)?];
    if examined.analysis.multipliers.is_some() {
        figures.insert(1, multipliers(examined)?);
    }
    if !examined.survival.is_empty() {
        figures.push(survival(examined)?);
    }
    Ok(figures)
}

/// Panels, at most three in a row.
fn panels(sheet: &mut Sheet, height: f64, specs: Vec<(Axis, Axis, String)>) -> Vec<Panel> {
    let mut drawn = Vec::new();
    for row in specs.chunks(PER_ROW) {
        let row = row.iter().map(|(x, y, title)| (1.0, x.clone(), y.clone(), Some(title.as_str()))).collect();
        drawn.extend(sheet.row(height, row));
    }
    drawn
}

/// Height of panels of which there are so many.
fn height_of(panels: usize) -> f64 {
    match panels {
        1 => 320.0,
        2 => 270.0,
        _ => 175.0,
    }
}

fn return_map(examined: &Examined) -> Result<Figure> {
    let stem = "stability-return-map";
    let record = &examined.record;
    let pairs = |i: usize| -> Vec<(f64, f64)> {
        let of = |b: &stridemap_stability::Bout| -> Vec<(f64, f64)> {
            b.states.windows(2).map(|x| (x[0][i], x[1][i])).collect()
        };
        record.bouts.iter().flat_map(of).collect()
    };
    let falls = |i: usize| -> Vec<(f64, f64)> {
        let of = |b: &stridemap_stability::Bout| Some((b.states.last()?[i], b.fallen_state.as_ref()?[i]));
        record.bouts.iter().filter_map(of).collect()
    };
    some(stem, "pairs of strides", pairs(0).len())?;
    let specs = record.state.iter().enumerate().map(|(i, name)| {
        let values: Vec<f64> = pairs(i).into_iter().chain(falls(i)).flat_map(|(a, b)| [a, b]).collect();
        let axis = |argument: &str| Axis::covering(&label(name, argument), values.iter().copied());
        (axis("(k)"), axis("(k + 1)"), plain(&quantity(name).0))
    });
    let mut sheet = Sheet::new(stem, "Return map: each stride against the next");
    let specs: Vec<_> = specs.collect();
    let height = height_of(specs.len());
    let mut csv = String::from("component,state,next_state,fell\n");
    for (i, mut p) in panels(&mut sheet, height, specs).into_iter().enumerate() {
        let points = pairs(i);
        column(stem, &record.state[i], &points.iter().map(|q| q.1).collect::<Vec<_>>(), points.len())?;
        p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 1.1);
        p.key("identity", Key::Line("ref", Dash::Solid));
        p.scatter("strides", &points, "s0", Mark::Dot, 3.0);
        p.scatter("falls", &falls(i), "s3", Mark::Diamond, 5.0);
        for (points, fell) in [(points, 0), (falls(i), 1)] {
            for (a, b) in points {
                csv += &format!("{},{a},{b},{fell}\n", record.state[i]);
            }
        }
        sheet.add(p);
    }
    let n = pairs(0).len();
    let caption = format!(
        "State at a section against that at the next, n = {n} pairs of {} strides; line: identity. A cloud along the identity is a \
         gait that forgets slowly, one along the other diagonal alternates from leg to leg.",
        record.strides()
    );
    Ok(sheet.finish(&caption, "Scatter plots of each component of the state at a section against the next.", csv))
}

fn multipliers(examined: &Examined) -> Result<Figure> {
    let stem = "stability-multipliers";
    let m = present(stem, "multipliers", examined.analysis.multipliers.as_ref())?;
    let mut sheet = Sheet::new(stem, "Multipliers: what is left of a deviation after a stride");
    let mut names = Axis::linear("", 0.4, 3.6);
    names.ticks = [(1.0, "largest"), (2.0, "slow"), (3.0, "flip")].map(|(x, name)| (x, name.to_owned())).into();
    let circle = || Axis::linear("real part", -1.12, 1.12);
    let row = vec![
        (1.0, circle(), Axis::linear("imaginary part", -1.12, 1.12), Some("In the unit circle")),
        (1.0, names, Axis::linear("multiplier", -1.12, 1.12), Some("With 95 % intervals")),
    ];
    let mut drawn = sheet.row(270.0, row);
    let (mut bars, mut plane) = (drawn.remove(1), drawn.remove(0));
    let arc = |r: f64| -> Vec<(f64, f64)> {
        (0..=120).map(|i| f64::from(i) * std::f64::consts::TAU / 120.0).map(|a| (r * a.cos(), r * a.sin())).collect()
    };
    plane.line(&arc(1.0), "ref", Dash::Solid, 1.6);
    plane.key("unit circle: no recovery", Key::Line("ref", Dash::Solid));
    let draws: Vec<(f64, f64)> = examined.eigenvalues.iter().map(|z| (z[0], z[1])).collect();
    plane.marks(&draws, "s2", Mark::Dot, 1.6);
    plane.key("draws from the posterior", Key::Mark("s2", Mark::Dot));
    for r in [m.largest.low, m.largest.high] {
        plane.line(&arc(r), "s1", Dash::Dashed, 1.4);
    }
    plane.key("interval of the largest modulus", Key::Line("s1", Dash::Dashed));
    let rows = [("largest", m.largest), ("slow", m.slow), ("flip", m.flip)];
    for y in [-1.0, 0.0, 1.0] {
        bars.across(y, "ref", if y == 0.0 { Dash::Dotted } else { Dash::Solid });
    }
    let mut csv = String::from("multiplier,value,low,high\n");
    let mut said = Vec::new();
    for (i, (name, Estimate { value, low, high })) in rows.into_iter().enumerate() {
        let x = 1.0 + i as f64;
        bars.error_bars(&[(x, low, high)], "s0", 7.0);
        bars.marks(&[(x, value)], "s0", Mark::Disc, 5.0);
        let [value, low, high] = [value, low, high].map(N);
        bars.hover(x, value.0, format!("{name}: {value:.2} ({low:.2} to {high:.2})"));
        said.push(format!("{name} {value:.2} ({low:.2} to {high:.2})"));
        csv += &format!("{name},{},{},{}\n", value.0, low.0, high.0);
    }
    bars.marks(&[(1.0, m.least_squares)], "s3", Mark::Diamond, 4.5);
    bars.key("least squares", Key::Mark("s3", Mark::Diamond));
    csv += &format!("least_squares,{},,\n", m.least_squares);
    sheet.add(plane);
    sheet.add(bars);
    let from = match m.method {
        Method::Posterior => "the posterior of the whole record",
        Method::Pieces => "four pieces of the record, because a check fired; the draws are of the whole record",
    };
    let caption = format!(
        "Intervals are from {from}: {}. Least squares: {:.2}. Below one is assumed, not shown. {} strides.",
        said.join(", "),
        N(m.least_squares),
        examined.record.strides()
    );
    let alt = format!("Multipliers in the unit circle and their intervals: {}.", said.join(", "));
    Ok(sheet.finish(&caption, &alt, csv))
}

fn residual_checks(examined: &Examined) -> Result<Figure> {
    const LAGS: usize = 10;
    let stem = "stability-residuals";
    let d = examined.record.state.len();
    let n: usize = examined.errors.iter().map(Vec::len).sum();
    some(stem, "residuals", n)?;
    let of = |i: usize| examined.errors.iter().map(move |bout| bout.iter().map(move |e| e[i]).collect::<Vec<f64>>());
    let mut sheet = Sheet::new(stem, "What the model does not predict");
    let edge = 2.2 / (n as f64).sqrt();
    let correlation = |i: usize, lag: usize| {
        let square: f64 = of(i).flatten().map(|e| e * e).sum();
        let product = |bout: Vec<f64>| bout.iter().zip(bout.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
        of(i).map(product).sum::<f64>() / square.max(1e-300)
    };
    let all: Vec<Vec<f64>> = (0..d).map(|i| (1..=LAGS).map(|lag| correlation(i, lag)).collect()).collect();
    let most = all.iter().flatten().fold(1.5 * edge, |most, r| most.max(r.abs())) * 1.1;
    let specs = examined.record.state.iter().map(|name| {
        (
            Axis::linear("lag (strides)", 0.0, LAGS as f64 + 0.8),
            Axis::linear("correlation", -most, most),
            plain(&quantity(name).0),
        )
    });
    let specs: Vec<_> = specs.collect();
    let height = height_of(specs.len()).min(230.0);
    let mut csv = String::from("component,lag,correlation\n");
    let bound = 1.96 / (n as f64).sqrt();
    for (i, mut p) in panels(&mut sheet, height, specs).into_iter().enumerate() {
        p.band(&[p.x.min, p.x.max], &[-bound; 2], &[bound; 2], "s2", 0.25);
        p.across(0.0, "ref", Dash::Solid);
        for (lag, r) in (1..).zip(&all[i]) {
            let x = f64::from(lag);
            p.bar((x - 0.3, x + 0.3), (0.0, *r), "s0", 0.8);
            p.hover(x, *r, format!("lag {lag}: {:.2}", N(*r)));
            csv += &format!("{},{lag},{r}\n", examined.record.state[i]);
        }
        p.key("autocorrelation of prediction errors", Key::Band("s0", 0.8));
        p.key("95 % where there is none", Key::Band("s2", 0.25));
        sheet.add(p);
    }
    let c = &examined.analysis.checks;
    let verdict = |pass: bool| if pass { "pass" } else { "fail" };
    let [white, steady] = [c.white_residuals.p, c.steady_mean.p].map(N);
    let caption = format!(
        "Correlation of one-step prediction errors with those some strides before, n = {n}. White residuals: p = {white:.3} ({}); steady \
         mean: p = {steady:.3} ({}).",
        verdict(c.white_residuals.pass),
        verdict(c.steady_mean.pass)
    );
    Ok(sheet.finish(&caption, "Autocorrelations of prediction errors.", csv))
}

fn survival(examined: &Examined) -> Result<Figure> {
    let stem = "stability-survival";
    let curve = &examined.survival;
    let pick = |q: usize| -> Vec<f64> { curve.iter().map(|s| 100.0 * s[q]).collect() };
    let (low, middle, high) = (pick(0), pick(1), pick(2));
    column(stem, "survival", &low, curve.len())?;
    let strides: Vec<f64> = (0..curve.len()).map(|k| k as f64).collect();
    let last = strides[strides.len() - 1];
    let mut sheet = Sheet::new(stem, "Still on its feet");
    let mut p = sheet.single(
        240.0,
        Axis::linear("strides walked", 0.0, last),
        Axis::linear("not fallen (%)", 0.0, 103.0),
        None,
    );
    p.band(&strides, &low, &high, "s0", 0.25);
    p.key("95 % of the maps that fit the record", Key::Band("s0", 0.25));
    let line: Vec<(f64, f64)> = strides.iter().copied().zip(middle).collect();
    p.line(&line, "s0", Dash::Solid, 2.0);
    p.key("median", Key::Line("s0", Dash::Solid));
    sheet.add(p);
    let rows = (0..curve.len()).map(|k| format!("{k},{},{},{}\n", curve[k][0], curve[k][1], curve[k][2]));
    let csv = format!("strides,low,median,high\n{}", rows.collect::<String>());
    let rule = examined.analysis.fall.as_ref().map_or("", |f| f.rule.as_str());
    let caption = format!(
        "Probability of no fall ({}) up to each stride, in maps drawn from their posterior, n = {} strides. Only the ends are to be \
         quoted: at most {:.1} % have fallen after {last:.0} strides.",
        rule.replace('_', " "),
        examined.record.strides(),
        N(100.0 - low[low.len() - 1])
    );
    Ok(sheet.finish(&caption, "Survival against strides with a 95 % band.", csv))
}
