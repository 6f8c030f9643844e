//! Data for Figs. 7 to 10.

use super::Lcg;
use stridemap_record::{ComparePoint, PushOutcome, PushPair, Spread};
use stridemap_report::figures::*;

pub fn fig7_data() -> Fig7 {
    let mut rng = Lcg(7);
    let x: Vec<f64> = (0..=200).map(|i| f64::from(i) * std::f64::consts::TAU / 200.0).collect();
    let sample_x = vec![0.35, 0.8, 1.0, 2.4, 2.7, 2.9, 3.3, 5.1, 5.4, 5.9];
    let sample_y = sample_x.iter().map(|v: &f64| v.sin() + 0.1 * rng.normal()).collect();
    let std: Vec<f64> = x
        .iter()
        .map(|v| {
            let near = sample_x.iter().map(|s| (v - s).abs()).fold(f64::INFINITY, f64::min);
            0.08 + 0.75 * (1.0 - (-0.8 * near * near).exp())
        })
        .collect();
    let mean = x.iter().zip(&std).map(|(v, s)| v.sin() * (1.08 - 0.5 * s)).collect();
    Fig7 { target: x.iter().map(|v| v.sin()).collect(), x, mean, std, std_with_noise: true, sample_x, sample_y }
}

pub fn fig8_data() -> Fig8 {
    let trials = (0..=15_u32)
        .map(|t| {
            let t64 = f64::from(t);
            let gp = -0.9 * (-0.75 * t64).exp() - 0.0016;
            let full = -0.85 * (-0.48 * t64).exp() - 0.0041;
            let spread = |mean: f64, share: f64| Spread { mean, sd: Some(share * mean.abs()) };
            ComparePoint {
                trial: t as usize,
                gp: spread(gp, 0.45),
                full: spread(full, 0.3),
                p_value: if t == 0 { None } else { Some(0.4 / (1.0 + t64 * t64 / 5.0)) },
            }
        })
        .collect();
    Fig8 { trials, seeds: 5, strides: 20 }
}

pub fn fig9_data() -> Fig9 {
    let mut rng = Lcg(9);
    let x: Vec<f64> = (0..=60).map(|i| f64::from(i) * 0.1).collect();
    let sigmoid = |v: f64, a: f64| 5.5 / (1.0 + (-a * (v - 2.1)).exp()) - 1.0;
    let curve = |a: f64, far: f64, rng: &mut Lcg| PolicyCurve {
        spread: x
            .iter()
            .map(|v| Spread {
                mean: sigmoid(*v, a) + far * (v - 4.0).max(0.0),
                sd: Some(0.25 + 0.12 * (v - 2.0).abs().powf(1.5)),
            })
            .collect(),
        visited: (0..140).map(|_| 2.1 + 0.75 * rng.normal()).collect(),
    };
    let gp = curve(1.7, -0.5, &mut rng);
    let full = curve(1.4, -1.2, &mut rng);
    Fig9 { psi_roll_deg: x.clone(), gp, full, seeds: 5, action_label: "A_{step} (deg)".to_owned() }
}

/// Pushes of the nominal gait and of the learned policy.
pub fn pushed() -> [PushOutcome; 2] {
    let mut rng = Lcg(10);
    [(0.66, 3.02, 1), (0.12, 2.03, 0)].map(|(slope, fixed, falls)| {
        let pair = |_| {
            let psi_roll_deg = fixed + 1.1 * rng.normal();
            let psi_roll_after_2_deg = fixed + slope * (psi_roll_deg - fixed) + 0.12 * rng.normal();
            let force_n = 80.0 * (rng.uniform() - 0.5);
            PushPair { k: 0, psi_roll_deg, psi_roll_after_1_deg: f64::NAN, psi_roll_after_2_deg, force_n }
        };
        PushOutcome {
            data: (0..39).map(pair).collect(),
            slope: Some(slope),
            fixed_point_deg: Some(fixed),
            falls,
            ..PushOutcome::default()
        }
    })
}
