//! A synthetic run directory, written as the lab crate writes one.

use super::Lcg;
use std::fs;
use std::path::Path;
use stridemap_map::{SavedLeaveOneOut, SavedMap};
use stridemap_record::{Frame, Recording};
use stridemap_robot::{Pose, Shape, ShapeKind};

/// What is wrong with the run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// A fall in the second batch.
    pub fall: bool,
    /// Killed in the second iteration: no summary, a torn line.
    pub killed: bool,
    /// One stride only.
    pub one_stride: bool,
}

const HEADER: &str = "iteration,phase,role,episode,k,time_s,stance,psi_roll_deg,last_step_amplitude_deg,\
step_amplitude_deg,next_psi_roll_deg,reward,end,stride_duration_s,fall_criterion,fall_value,fall_threshold";

fn stride(rng: &mut Lcg, psi: f64, action: f64) -> f64 {
    2.13 + 0.5 * (psi - 2.2) - 0.22 * (action - 1.9) + 0.08 * rng.normal()
}

fn action(psi: f64, gain: f64) -> f64 {
    (2.1 + gain * (psi - 2.0)).clamp(-1.5, 5.0)
}

fn rows(
    rng: &mut Lcg,
    prefix: &str,
    role: &str,
    iteration: u32,
    n: u32,
    gain: Option<f64>,
    fall_at: Option<u32>,
) -> String {
    let (mut psi, mut out, mut last) = (3.0, String::new(), 0.0);
    for k in 0..n {
        let u = gain.map_or(0.0, |g| action(psi, g)) + if role == "training" { 0.5 * rng.normal() } else { 0.0 };
        let fell = fall_at == Some(k);
        let next = if fell {
            -0.4
        } else if gain.is_none() && role == "record" {
            3.0 + 0.1 * rng.normal()
        } else {
            stride(rng, psi, u)
        };
        let reward = if fell { -1.0 } else { -0.1 * (next - 2.0) * (next - 2.0) };
        let end = if fell { "fell" } else { "crossing" };
        let fall = if fell { "psi_roll,-0.4,0" } else { ",," };
        let stance = if k % 2 == 0 { "left" } else { "right" };
        out.push_str(&format!(
            "{prefix}{iteration},collect,{role},{iteration},{k},{:.3},{stance},{psi},{last},{u},{next},{reward},{end},0.577,{fall}\n",
            0.577 * f64::from(k)
        ));
        last = u;
        psi = if fell { 3.0 } else { next };
    }
    out
}

/// Writes the run.
pub fn write_run(dir: &Path, seed: u64, faults: Faults) {
    let mut rng = Lcg(seed);
    let put = |file: &str, text: &str| {
        let path = dir.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    put(
        "config.toml",
        "name = \"stepping\"\nstate = [\"psi_roll_deg\"]\n\n[[reward]]\nquantity = \"psi_roll_squared_error\"\nweight = 0.1\ntarget_deg = 2.0\n\n[robot]\nmodel = \"biped\"\n",
    );
    let end = if faults.killed { "null" } else { "\"2026-11-23T12:00:05Z\"" };
    put(
        "provenance.json",
        &format!(
            "{{\"version\":\"0.1.0\",\"git_revision\":\"0123abc\",\"mujoco_version\":\"3.17.0\",\"model_hash\":\"sha256:89ab\",\"seed\":{seed},\"machine\":\"x86_64 linux, 2 cores\",\"command\":\"stridemap learn stepping --seed {seed}\",\"start\":\"2026-11-23T12:00:00Z\",\"end\":{end}}}"
        ),
    );
    put("columns.json", "{\"state\":[\"psi_roll_deg\"],\"action\":[\"step_amplitude_deg\"]}");
    let iterations = if faults.one_stride {
        1
    } else if faults.killed {
        2
    } else {
        4
    };
    let (mut transitions, mut learning) =
        (format!("{HEADER}\n"), String::from("iteration,trial,world,average_reward,falls,strides\n"));
    for i in 1..=iterations {
        let n = if faults.one_stride {
            1
        } else if faults.killed && i == 2 {
            7
        } else {
            20
        };
        let fall = (faults.fall && i == 2).then_some(11);
        transitions.push_str(&rows(&mut rng, "", "training", i, n, Some(f64::from(i - 1)), fall));
        if faults.one_stride || (faults.killed && i == 2) {
            continue;
        }
        for t in 1..=60 {
            let reward = -0.35 * (-0.12 * f64::from(t)).exp() - 0.004 / f64::from(i) * (1.0 + 0.5 * rng.uniform());
            learning.push_str(&format!("{i},{t},map,{reward},{},24\n", u32::from(t < 4)));
        }
        learning.push_str(&format!("{i},{i},robot,{},0,100\n", -0.02 / f64::from(i * i)));
        write_learned(&put, &mut rng, i);
    }
    if faults.killed {
        transitions.push_str("2,collect,training,2,7,4.0");
    }
    put("transitions.csv", &transitions);
    put("learning.csv", &learning);
    let mut record = format!("what,{HEADER}\n");
    record.push_str(&rows(&mut rng, "nominal,", "record", 0, 60, None, None));
    if !(faults.killed || faults.one_stride) {
        record.push_str(&rows(&mut rng, "final,", "record", 4, 60, Some(3.0), None));
    }
    put("record.csv", &record);
    write_poses(&put, "nominal", 3.0, None);
    if faults.killed || faults.one_stride {
        return;
    }
    let falls = u32::from(faults.fall);
    put("summary.json", &format!("{{\"experiment\":\"stepping\",\"seed\":{seed},\"strides\":{{\"training\":80,\"evaluation\":0,\"warm_up\":0,\"record\":120}},\"iterations\":[{}],\"nominal\":{{\"strides\":100,\"mean_reward\":-0.1021,\"mean_psi_roll_deg\":3.01,\"falls\":0,\"stalls\":0}},\"final\":{{\"strides\":100,\"mean_reward\":-0.00062,\"mean_psi_roll_deg\":2.004,\"falls\":0,\"stalls\":0,\"speed_m_s\":null}},\"seconds\":{{\"simulation\":1.1,\"fit\":0.01,\"improve\":0.2,\"total\":1.31}}}}",
        (1..=4).map(|i| format!("{{\"iteration\":{i},\"strides\":20,\"falls\":{},\"strides_so_far\":{},\"falls_so_far\":{falls},\"log_marginal_likelihood\":[12.3],\"mean_reward\":{},\"success\":false}}", if i == 2 { falls } else { 0 }, 20 * i, -0.02 / f64::from(i * i * i) - 0.0006)).collect::<Vec<_>>().join(",")));
    for (stem, slope, fixed, falls) in [("push", 0.12, 2.03, 0), ("push-nominal", 0.66, 3.02, 1)] {
        let mut csv = String::from("k,psi_roll_deg,psi_roll_after_1_deg,psi_roll_after_2_deg,force_n\n");
        for k in 0..39 {
            let psi = fixed + 0.9 * rng.normal();
            csv.push_str(&format!(
                "{},{psi},{},{},{}\n",
                10 + 4 * k,
                fixed + 0.5 * (psi - fixed),
                fixed + slope * (psi - fixed) + 0.1 * rng.normal(),
                80.0 * (rng.uniform() - 0.5)
            ));
        }
        put(&format!("{stem}.csv"), &csv);
        put(
            &format!("{stem}.json"),
            &format!(
                "{{\"slope\":{slope},\"fixed_point_deg\":{fixed},\"falls\":{falls},\"pairs\":39,\"strides\":160,\"force_n\":40.0,\"duration_s\":0.2}}"
            ),
        );
    }
    write_poses(&put, "final", 2.0, Some(3.2));
}

fn write_learned(put: &impl Fn(&str, &str), rng: &mut Lcg, i: u32) {
    let gain = f64::from(i);
    let mut policy = String::from("along,psi_roll_deg,mean_step_amplitude_deg,std_step_amplitude_deg,value\n");
    for j in 0..=120 {
        let psi = -1.25 + 7.0 * f64::from(j) / 120.0;
        policy.push_str(&format!(
            "0,{psi},{},{},{}\n",
            1.9 + 3.1 * (0.3 * gain * (psi - 2.0)).tanh(),
            0.2 + 0.3 / (1.0 + (psi - 2.0).powi(2)),
            -0.4 * (psi - 2.0).powi(2)
        ));
    }
    put(&format!("figures/data/policy-{i}.csv"), &policy);
    put(&format!("policy/{i}.json"), include_str!("../../../mutate/corpus/policy/1.json"));
    let mut map = String::from(
        "state_axis,action_axis,psi_roll_deg,step_amplitude_deg,mean_psi_roll_deg,latent_std_psi_roll_deg,noise_std_psi_roll_deg\n",
    );
    for a in 0..41 {
        for b in 0..41 {
            let (x, u) = (0.5 + 0.1 * f64::from(a), -1.0 + 0.15 * f64::from(b));
            let far = ((x - 2.2) / 1.2).powi(2) + ((u - 2.0) / 1.6).powi(2);
            map.push_str(&format!(
                "0,0,{x},{u},{},{},0.08\n",
                2.13 + 0.5 * (x - 2.2) - 0.22 * (u - 1.9),
                0.03 + 0.5 * (1.0 - (-0.5 * far).exp())
            ));
        }
    }
    put(&format!("figures/data/map-{i}.csv"), &map);
    let mut lines = String::from(
        "along,psi_roll_deg,step_amplitude_deg,mean_psi_roll_deg,latent_std_psi_roll_deg,noise_std_psi_roll_deg\n",
    );
    for along in 0..2 {
        for j in 0..=40 {
            let t = f64::from(j) / 20.0 - 1.0;
            let (x, u) = if along == 0 { (2.2 + t, 1.9) } else { (2.2, 1.9 + 2.0 * t) };
            let mean = 2.13 + 0.5 * (x - 2.2) - 0.22 * (u - 1.9);
            lines.push_str(&format!("{along},{x},{u},{mean},{},0.08\n", 0.03 + 0.1 * t * t));
        }
    }
    put(&format!("figures/data/lines-{i}.csv"), &lines);
    let n = 20 * i as usize;
    let actual: Vec<f64> = (0..n).map(|_| 2.2 + 0.5 * rng.normal()).collect();
    let mean: Vec<f64> = actual.iter().map(|a| a + 0.09 * rng.normal()).collect();
    let text = include_str!("../../../mutate/corpus/map/1.json");
    let mut card: SavedMap = serde_json::from_str(text).unwrap();
    card.iteration = i as usize;
    let output = &mut card.outputs[0];
    output.warnings = vec!["the length scale of `step_amplitude_deg` is at its upper limit".to_owned()];
    output.leave_one_out = SavedLeaveOneOut { mean, std: vec![0.09; n], actual };
    put(&format!("map/{i}.json"), &serde_json::to_string(&card).unwrap());
}

/// Seven bodies stepping in place: torso, and thigh, shank and foot of each leg.
fn write_poses(put: &impl Fn(&str, &str), what: &str, sway_deg: f64, push_at: Option<f64>) {
    let shape = |body: usize, kind: ShapeKind, z: f64, x: f64, rgba: [f32; 4]| Shape {
        name: String::new(),
        body,
        kind,
        pose: Pose { position_m: [x, 0.0, z], orientation: [1.0, 0.0, 0.0, 0.0] },
        rgba,
    };
    let grey = [0.55, 0.6, 0.66, 1.0];
    let mut shapes = vec![
        shape(0, ShapeKind::Box { half_extents_m: [0.09, 0.15, 0.3] }, 0.33, 0.0, [0.3, 0.45, 0.62, 1.0]),
        shape(0, ShapeKind::Sphere { radius_m: 0.1 }, 0.75, 0.0, [0.3, 0.45, 0.62, 1.0]),
    ];
    for leg in 0..2 {
        let b = 1 + 3 * leg;
        shapes.push(shape(b, ShapeKind::Capsule { radius_m: 0.06, half_length_m: 0.14 }, -0.185, 0.0, grey));
        shapes.push(shape(b + 1, ShapeKind::Capsule { radius_m: 0.045, half_length_m: 0.14 }, -0.185, 0.0, grey));
        shapes.push(shape(
            b + 2,
            ShapeKind::Box { half_extents_m: [0.125, 0.065, 0.015] },
            -0.045,
            0.015,
            [0.25, 0.28, 0.32, 1.0],
        ));
    }
    let frames = (0..300)
        .map(|i| {
            let t = 0.02 * f64::from(i);
            let phase = std::f64::consts::PI * t / 0.577;
            let roll = (sway_deg * phase.sin()).to_radians();
            let y = -0.06 * phase.sin();
            let q = |angle: f64, axis: usize| {
                let mut q = [(0.5 * angle).cos(), 0.0, 0.0, 0.0];
                q[axis + 1] = (0.5 * angle).sin();
                q
            };
            let pose = |p: [f64; 3], q: [f64; 4]| [p[0], p[1], p[2], q[0], q[1], q[2], q[3]];
            let hip = 0.75;
            let mut poses = vec![pose([0.0, y, hip], q(roll, 0))];
            for side in [1.0, -1.0] {
                let lift = (side * phase.sin()).max(0.0);
                let bend = 0.35 + 0.3 * lift;
                let h = [0.0, y + side * 0.09, hip];
                let knee = [0.37 * bend.sin(), h[1], hip - 0.37 * bend.cos()];
                let ankle = [0.0, h[1] - 0.3 * y, knee[2] - 0.37 * bend.cos()];
                poses.push(pose(h, q(-bend, 1)));
                poses.push(pose(knee, q(bend, 1)));
                poses.push(pose(ankle, q(0.0, 1)));
            }
            Frame {
                time_s: 10.0 + t,
                poses,
                cop_m: Some([0.02, -0.09 * phase.sin().signum()]),
                loads_n: if phase.sin() > 0.0 { [0.0, 930.0] } else { [930.0, 0.0] },
                crossing: i > 0 && (t / 0.577).floor() > ((t - 0.02) / 0.577).floor(),
                push_n: push_at.filter(|p| (t - p).abs() < 0.1).map(|_| [0.0, 32.0, 0.0]),
            }
        })
        .collect();
    let recording = Recording { format: 1, shapes, period_s: 0.02, frames };
    put(&format!("poses/{what}.json"), &serde_json::to_string(&recording).unwrap());
}
