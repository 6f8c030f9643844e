//! Time of an imagined stride, the counterpart of `benches/peers/jax_roll.py`: a Gaussian process for each output and a
//! draw, each stride starting where the last one ended.
//!
//! ```text
//! cargo run --release -p stridemap-gp --example stride
//! ```

#![allow(clippy::print_stdout, reason = "an example's answer goes to standard output")]

use cpu_time::ProcessTime;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_gp::{Gp, GpError, Hyperparameters, Kernel, Mean, Points};

const STRIDES: usize = 1000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for (n, dims, outputs) in [(20, 2, 1), (100, 4, 3)] {
        let map = map(n, dims, outputs)?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut times = Vec::new();
        let mut last = 0.0;
        for _ in 0..51 {
            let mut state = vec![0.0; outputs.max(dims - 1)];
            let mut input = vec![0.0; dims];
            let begin = ProcessTime::now();
            for _ in 0..STRIDES {
                // The policy of jax_roll.py: a bounded linear feedback.
                let action: f64 = state.iter().map(|x| 0.1 * x).sum();
                input[..dims - 1].copy_from_slice(&state[..dims - 1]);
                input[dims - 1] = action.tanh();
                for (model, next) in map.iter().zip(&mut state) {
                    let (at, normal): (_, f64) = (model.predict(&input)?, StandardNormal.sample(&mut rng));
                    *next = at.mean + at.latent_variance.sqrt() * normal;
                }
                state.iter_mut().for_each(|x| *x = x.clamp(-1.0, 1.0));
            }
            times.push(begin.elapsed().as_secs_f64() / STRIDES as f64);
            last += state[0];
        }
        times.sort_by(f64::total_cmp);
        println!(
            "N={n} d={dims} outputs={outputs}: {:.3} us a stride (min {:.3}; checksum {last:.3})",
            1e6 * times[times.len() / 2],
            1e6 * times[0],
        );
    }
    Ok(())
}

fn map(n: usize, dims: usize, outputs: usize) -> Result<Vec<Gp>, GpError> {
    let x: Vec<f64> = (0..n * dims).map(|i| ((i * i * 5 + i) as f64).sin()).collect();
    let points = Points::new(&x, dims)?;
    (0..outputs)
        .map(|e| {
            let y: Vec<f64> = points
                .rows()
                .map(|x| x.iter().enumerate().map(|(d, x)| x * (d + e) as f64).sum::<f64>().sin())
                .collect();
            let hyperparameters =
                Hyperparameters { length_scales: vec![0.8; dims], signal_variance: 1.0, noise_variance: 0.01 };
            Gp::condition(points, &y, Kernel::SquaredExponential, Mean::Zero, hyperparameters)
        })
        .collect()
}
