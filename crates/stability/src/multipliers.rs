//! Multipliers of a record, with their checks.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};

use crate::answer::{
    Check, Checks, Estimate, LongEnough, Method, Multipliers, NoiseSource, Refusal, SensorNoise, Unstable,
};
use crate::checks::{Whiteness, excited, growing, independent_looks, innovations, steady_mean};
use crate::error::StabilityError;
use crate::linear::{Looks, Model, Moments, Sensor};
use crate::record::{Record, Standardised};
use crate::sampler::{Draws, Settings, sample};
use crate::small::{Mat, modes};

/// What is known of the sensor's noise.
#[derive(Clone, Debug, PartialEq)]
pub enum SensorKnowledge {
    /// There is none.
    Exact,
    /// Its standard deviation by component of the state, in the component's unit; the others are estimated.
    Given(Vec<Option<f64>>),
    /// From second looks at each section, whose noise is independent of the first's.
    TwoLooks,
    /// From the record.
    Estimated,
}

/// A check fails below this.
const LEVEL: f64 = 0.05;
/// Pieces of a record that is not of one piece.
const PIECES: usize = 4;

/// Least squares: the map.
pub(crate) fn least_squares<const D: usize>(data: &Standardised<D>) -> Mat<D> {
    let (c, _) = Moments::of(&data.series, &data.series.bouts).least_squares(data.series.regressors());
    Model { c, q: [[0.0; D]; D], r: [0.0; D] }.a()
}

/// What a record says of its multipliers.
pub(crate) struct Found {
    pub multipliers: Option<Multipliers>,
    pub checks: Checks,
    pub refused: Vec<Refusal>,
    /// Whether one map holds for the whole record, however heavy the tails of its noise.
    pub one_map: bool,
    /// Multipliers of draws of the whole record, real and imaginary parts.
    pub eigenvalues: Vec<[f64; 2]>,
    /// One-step prediction errors of the model, by stretch, in standard deviations of the state's components.
    pub errors: Vec<Vec<Vec<f64>>>,
}

/// Strides that a state of d components needs.
pub(crate) fn strides_needed(d: usize) -> usize {
    10 * (d + 1)
}

/// Multipliers and checks of a record that was checked, of D components.
pub(crate) fn find<const D: usize>(
    record: &Record,
    knowledge: &SensorKnowledge,
    seed: u64,
) -> Result<Found, StabilityError> {
    let data = Standardised::<D>::of(record)?;
    let mut refused = Vec::new();
    let mut knowledge = knowledge.clone();
    if knowledge == SensorKnowledge::TwoLooks {
        if data.looks.is_none() {
            return Err(StabilityError::NoSecondLook { name: record.state[0].clone() });
        }
        if independent_looks(&data.differences) < LEVEL / 5.0 {
            let remedy = "the two looks' differences are correlated from stride to stride: give --sensor-noise";
            refused.push(Refusal::new("multipliers.sensor_noise.two_looks", "looks_not_independent", remedy));
            knowledge = SensorKnowledge::Estimated;
        }
    }
    let drawn = draw(record, &data, &knowledge, seed, 0);
    let errors = innovations(&data.series, &drawn.model);
    let strides = record.strides();
    let needed = strides_needed(D);
    let grows = growing(&data.series, &mut stream(seed, 9));
    let whiteness = Whiteness::of(&errors, drawn.fitted_noise);
    let [excited, white_residuals, steady_mean] =
        [excited(&data.series), whiteness.p(drawn.fitted_noise), steady_mean(&data.series, &errors)];
    let checks = Checks {
        excited: Check { p: excited, pass: excited < LEVEL },
        white_residuals: Check { p: white_residuals, pass: white_residuals >= LEVEL },
        steady_mean: Check { p: steady_mean, pass: steady_mean >= LEVEL },
        unstable: Unstable { probability_flat: grows, pass: grows <= 0.5 },
        long_enough: LongEnough { strides, needed, pass: strides >= needed },
    };
    let multipliers = answer(record, &data, &knowledge, &drawn, &checks, seed, &mut refused);
    let errors = errors.iter().map(|b| b.iter().map(|e| e.to_vec()).collect()).collect();
    let one_map = checks.steady_mean.pass && whiteness.signed >= LEVEL;
    Ok(Found { one_map, multipliers, checks, refused, eigenvalues: drawn.eigenvalues, errors })
}

/// What is refused, and what is left to say.
fn answer<const D: usize>(
    record: &Record,
    data: &Standardised<D>,
    knowledge: &SensorKnowledge,
    drawn: &Drawn<D>,
    checks: &Checks,
    seed: u64,
    refused: &mut Vec<Refusal>,
) -> Option<Multipliers> {
    if drawn.fitted_noise && !checks.excited.pass {
        let remedy = "no stride remembers the one before: kick an action at random (--action), or give --sensor-noise";
        refused.push(Refusal::new("multipliers", "nothing_excited", remedy));
        return None;
    }
    let more = format!("{} strides for {} components of the state", checks.long_enough.needed, D);
    if !checks.long_enough.pass && drawn.fitted_noise {
        refused.push(Refusal::new(
            "multipliers",
            "short_record_and_unknown_sensor",
            format!("{more}, or --sensor-noise"),
        ));
        return None;
    }
    if !checks.long_enough.pass {
        refused.push(Refusal::new(
            "multipliers.level",
            "short_record",
            format!("{more}: the intervals lean on the prior"),
        ));
    }
    if !checks.unstable.pass {
        let remedy = "the gait may be growing: the intervals end below one because that is assumed; walk longer";
        refused.push(Refusal::new("multipliers.largest.high", "may_be_unstable", remedy));
    }
    let steady = checks.white_residuals.pass && checks.steady_mean.pass;
    let parts = match steady {
        true => None,
        false if record.strides() / PIECES < strides_needed(D) / 2 => {
            let remedy =
                format!("the gait changed and the record is too short for four pieces: {}", 2 * strides_needed(D));
            refused.push(Refusal::new("multipliers", "not_of_one_piece", format!("{remedy} strides")));
            return None;
        }
        false => Some(of_pieces::<D>(record, knowledge, seed)),
    };
    let [largest, slow, flip] = match &parts {
        Some(parts) => *parts,
        None => std::array::from_fn(|mode| Estimate::of(drawn.draws.iter().map(|m| m[mode]).collect())),
    };
    let assumes: &[&str] = if steady { &["below_one", "one_linear_map", "white_noise"] } else { &["below_one"] };
    Some(Multipliers {
        level: 0.95,
        assumes: assumes.iter().map(|&word| word.into()).collect(),
        largest,
        slow,
        flip,
        half_life_strides: largest.map(half_life_strides),
        least_squares: modes(&least_squares(data))[0],
        sensor_noise: SensorNoise { source: drawn.source, share_of_variance: drawn.model.r.to_vec() },
        method: if steady { Method::Posterior } else { Method::Pieces },
        strides_per_state: record.strides() / D,
    })
}

/// Strides until half of a deviation is left.
fn half_life_strides(modulus: f64) -> f64 {
    let strides = std::f64::consts::LN_2 / -modulus.clamp(1e-9, 1.0 - 1e-12).ln();
    strides.max(0.0)
}

pub(crate) struct Drawn<const D: usize> {
    /// Largest modulus, largest and smallest real part.
    pub draws: Vec<[f64; 3]>,
    eigenvalues: Vec<[f64; 2]>,
    model: Model<D>,
    source: NoiseSource,
    /// Whether some component's noise was estimated from the record alone.
    fitted_noise: bool,
}

/// A random stream of its own.
fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    rng
}

/// Whether stretches begin off the steady state of the others, as after a fall.
fn begins_off<const D: usize>(data: &Standardised<D>) -> bool {
    const OFF: f64 = 0.01;
    let all = data.series.bouts.iter().flatten();
    let n = all.clone().count() as f64;
    let mut cov = [[0.0; D]; D];
    for x in all {
        for i in 0..D {
            for j in 0..D {
                cov[i][j] += x[i] * x[j] / n;
            }
            cov[i][i] += 1e-9;
        }
    }
    let l = crate::small::cholesky(&cov);
    let starts = data.series.bouts.iter().filter_map(|x| x.first());
    let distance: f64 = starts.clone().map(|x| crate::small::forward(&l, *x).iter().map(|z| z * z).sum::<f64>()).sum();
    let dof = (D * starts.count()) as f64;
    ChiSquared::new(dof).is_ok_and(|d| d.sf(distance) < OFF)
}

/// Draws from the posterior of a record.
pub(crate) fn draw<const D: usize>(
    record: &Record,
    data: &Standardised<D>,
    knowledge: &SensorKnowledge,
    seed: u64,
    piece: u64,
) -> Drawn<D> {
    let unknown = [None; D];
    let (sensor, source) = match knowledge {
        SensorKnowledge::Exact => (Sensor::Exact, NoiseSource::None),
        SensorKnowledge::Given(stds) => {
            let known = std::array::from_fn(|i| stds.get(i).copied().flatten().map(|s| (s / data.stds[i]).powi(2)));
            (Sensor::Noisy { known, looks: None }, NoiseSource::Given)
        }
        SensorKnowledge::TwoLooks => {
            let looks = data.looks.as_ref().map(|l| Looks { squares: l.squares, count: l.count });
            (Sensor::Noisy { known: unknown, looks }, NoiseSource::TwoLooks)
        }
        SensorKnowledge::Estimated => (Sensor::Noisy { known: unknown, looks: None }, NoiseSource::Estimated),
    };
    let all_known = match &sensor {
        Sensor::Exact => true,
        Sensor::Noisy { known, .. } => known.iter().all(Option::is_some),
    };
    let steady = !record.is_probed() && !begins_off(data);
    let kappa = match (steady, all_known) {
        (false, _) => 0.0,
        (true, true) => 1.0,
        (true, false) => 1.0 / D as f64,
    };
    let (burn, keep, thin) = match sensor {
        // A sweep without states is short, and new coefficients of many components are often refused.
        Sensor::Exact => (100, 1000, 2 * D - 1),
        Sensor::Noisy { .. } => (400, 1000, 2),
    };
    let settings = Settings { steady, kappa, burn, keep, thin };
    let Draws { modes, eigenvalues, mean } = sample(&data.series, &sensor, &settings, stream(seed, piece));
    Drawn { draws: modes, eigenvalues, model: mean, source, fitted_noise: !all_known && data_looks(knowledge) }
}

/// Whether nothing but the record says how noisy the sensor is.
fn data_looks(knowledge: &SensorKnowledge) -> bool {
    !matches!(knowledge, SensorKnowledge::TwoLooks)
}

/// Intervals from four pieces, each with a map of its own: random effects on the scale on which a mode has no end,
/// with as many degrees of freedom as there are pieces, less one.
fn of_pieces<const D: usize>(record: &Record, knowledge: &SensorKnowledge, seed: u64) -> [Estimate; 3] {
    const INSIDE: f64 = 1e-6;
    let logit = |x: f64| {
        let x = x.clamp(INSIDE, 1.0 - INSIDE);
        (x / (1.0 - x)).ln()
    };
    let fisher = |x: f64| x.clamp(INSIDE - 1.0, 1.0 - INSIDE).atanh();
    let parts: Vec<Drawn<D>> = record
        .pieces(PIECES)
        .iter()
        .zip(1..)
        .filter_map(|(piece, number)| Some(draw(piece, &Standardised::of(piece).ok()?, knowledge, seed, number)))
        .collect();
    std::array::from_fn(|mode| {
        let scale = |x: f64| if mode == 0 { logit(x) } else { fisher(x) };
        let back = |z: f64| if mode == 0 { 1.0 / (1.0 + (-z).exp()) } else { z.tanh() };
        let of = |part: &Drawn<D>| {
            let mut z: Vec<f64> = part.draws.iter().map(|m| scale(m[mode])).collect();
            z.sort_by(f64::total_cmp);
            let spread = crate::answer::quantile(&z, 0.8413) - crate::answer::quantile(&z, 0.1587);
            (crate::answer::quantile(&z, 0.5), 0.25 * spread * spread)
        };
        let each: Vec<(f64, f64)> = parts.iter().map(of).collect();
        let n = each.len() as f64;
        let mean = each.iter().map(|e| e.0).sum::<f64>() / n;
        let between = each.iter().map(|e| (e.0 - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        // The scatter of the pieces holds that within them; by chance it may look smaller.
        let within = each.iter().map(|e| e.1).sum::<f64>() / n;
        let t = StudentsT::new(0.0, 1.0, (n - 1.0).max(1.0)).map_or(3.18, |t| t.inverse_cdf(0.975));
        let half = t * (between.max(within) / n).sqrt();
        Estimate { value: mean, low: mean - half, high: mean + half }.map(back)
    })
}
