//! Times of the engine, each beside the floor of the processor where one was measured.
//!
//! ```text
//! cargo bench -p stridemap-gp
//! ```
//!
//! The floors, plain C kernels of `benches/peers/floor.c` on one AVX-512 core: a prediction 24.5 ns
//! at N = 20 and 250 ns at N = 100; evidence and gradient 3.5 us, 90 us and 3.65 ms at N = 20, 100
//! and 500, by LAPACK.

#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]
#![allow(clippy::unwrap_used, reason = "a benchmark may stop where it stands")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_gp::{FitOptions, Gp, Hyperparameters, Kernel, LogMarginalLikelihood, Mean, Points, Scratch};

/// `(N, D)` of the tables.
const SIZES: [(usize, usize); 3] = [(20, 2), (100, 4), (500, 2)];

fn data(n: usize, dims: usize) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n * dims).map(|i| ((i * i * 5 + i) as f64).sin()).collect();
    let y = x.chunks_exact(dims).enumerate();
    let y = y.map(|(i, x)| (2.0 * x[0]).sin() + x[1] * x[1] + 0.1 * (37.0 * i as f64).sin());
    (x.clone(), y.collect())
}

fn hyperparameters(dims: usize) -> Hyperparameters {
    Hyperparameters { length_scales: vec![0.8; dims], signal_variance: 1.0, noise_variance: 0.01 }
}

fn model(n: usize, dims: usize) -> Gp {
    let (x, y) = data(n, dims);
    let points = Points::new(&x, dims).unwrap();
    let kernel = Kernel::SquaredExponential;
    Gp::condition(points, &y, kernel, Mean::Zero, hyperparameters(dims)).unwrap()
}

fn each(criterion: &mut Criterion, name: &str, mut body: impl FnMut(&mut criterion::Bencher, usize, usize)) {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(20);
    for (n, dims) in SIZES {
        group.bench_function(BenchmarkId::from_parameter(n), |bencher| body(bencher, n, dims));
    }
    group.finish();
}

fn benches(criterion: &mut Criterion) {
    each(criterion, "evidence and gradient", |bencher, n, dims| {
        let (x, y) = data(n, dims);
        let points = Points::new(&x, dims).unwrap();
        let kernel = Kernel::SquaredExponential;
        let mut likelihood = LogMarginalLikelihood::new(points, &y, kernel, Mean::Zero).unwrap();
        let (at, mut gradient) = (hyperparameters(dims), vec![0.0; 2 + dims]);
        bencher.iter(|| likelihood.evaluate(black_box(&at), &mut gradient).unwrap());
    });
    each(criterion, "fit", |bencher, n, dims| {
        let (x, y) = data(n, dims);
        let points = Points::new(&x, dims).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let options = FitOptions { starts: 1, ..FitOptions::default() };
        bencher.iter(|| Gp::fit(points, &y, &options, &mut rng).unwrap());
    });
    each(criterion, "predict one", |bencher, n, dims| {
        let (gp, mut scratch) = (model(n, dims), Scratch::new());
        let (queries, _) = data(1000, dims);
        let mut rows = queries.chunks_exact(dims).cycle();
        bencher.iter(|| gp.predict_with(rows.next().unwrap(), &mut scratch).unwrap());
    });
    each(criterion, "predict 1000", |bencher, n, dims| {
        let (gp, mut scratch) = (model(n, dims), Scratch::new());
        let (queries, _) = data(1000, dims);
        let queries = Points::new(&queries, dims).unwrap();
        let (mut mean, mut variance) = (vec![0.0; 1000], vec![0.0; 1000]);
        bencher.iter(|| gp.predict_batch(queries, &mut mean, &mut variance, &mut scratch).unwrap());
    });
    each(criterion, "imagined stride", |bencher, n, dims| {
        // One output at N = 20, three elsewhere; each stride starts where the last one ended.
        let outputs = if n == 20 { 1 } else { 3 };
        let map = vec![model(n, dims); outputs];
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut input, mut next) = (vec![0.1; dims], vec![0.0; outputs]);
        bencher.iter(|| {
            for (model, next) in map.iter().zip(&mut next) {
                let (at, normal): (_, f64) = (model.predict(&input).unwrap(), StandardNormal.sample(&mut rng));
                *next = at.mean + at.latent_variance.sqrt() * normal;
            }
            input[0] = next[0].clamp(-1.0, 1.0);
        });
    });
    each(criterion, "add and drop a point", |bencher, n, dims| {
        let mut gp = model(n, dims);
        let x = vec![0.37; dims];
        bencher.iter(|| {
            gp.add_point(&x, 0.5).unwrap();
            gp.drop_point(0).unwrap();
        });
    });
}

criterion_group!(all, benches);
criterion_main!(all);
