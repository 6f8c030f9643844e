//! The simple example of [MA09, sec. 4.1, fig. 7]: ten noisy points of a sine, and what a Gaussian
//! process makes of them.
//!
//! ```text
//! cargo run --release -p stridemap-gp --example sine > sine.csv
//! ```
//!
//! `v₀ = 1`, `v₁ = 0.01`, `v_k = 1` as in the paper; columns: `z`, target, mean, standard deviation
//! of the latent function. The standard deviation is large where no data were drawn.

#![allow(clippy::print_stdout, reason = "an example's answer goes to standard output")]

use std::f64::consts::TAU;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let noise = Normal::new(0.0, 0.01_f64.sqrt())?;
    let z: Vec<f64> = (0..10).map(|_| rng.random_range(0.0..TAU)).collect();
    let y: Vec<f64> = z.iter().map(|z| z.sin() + noise.sample(&mut rng)).collect();
    let hyperparameters = Hyperparameters { length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.01 };
    let points = Points::new(&z, 1)?;
    let gp = Gp::condition(points, &y, Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    println!("z,target,mean,std");
    for i in 0..=100 {
        let z = TAU * f64::from(i) / 100.0;
        let at = gp.predict(&[z])?;
        println!("{z:.4},{:.4},{:.4},{:.4}", z.sin(), at.mean, at.latent_variance.sqrt());
    }
    Ok(())
}
