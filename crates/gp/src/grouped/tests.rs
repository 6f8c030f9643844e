use super::*;

fn rows(n: usize) -> Vec<f64> {
    (0..3 * n).map(|i| ((i * i) as f64 * 0.37).sin() * 1.3).collect()
}

fn options(bends: bool) -> GroupedOptions {
    GroupedOptions { first: 2, bends, medians: [0.6, 0.6, 0.5, 3.6, 2.0, 0.4], log_std: 1.0 }
}

/// The gradient is that of the value, by central differences.
#[test]
fn the_gradient_is_the_slope_of_the_value() {
    let n = 17;
    let inputs = rows(n);
    let (columns, stride) = columns_of(&inputs, 3);
    let arch = Arch::new();
    let grams = [
        Gram::of(&columns[..2 * stride], stride, n, arch),
        Gram::of(&columns[2 * stride..3 * stride], stride, n, arch),
    ];
    let y: Vec<f64> = inputs.chunks(3).map(|r| r[0] - 0.5 * r[2] + (2.0 * r[2]).sin()).collect();
    let options = options(true);
    let square = || vec![0.0; n * stride];
    let mut posterior = Posterior {
        options: &options,
        grams: &grams,
        y: &y,
        n,
        stride,
        arch,
        dense: DenseScratch::new(n),
        bent: square(),
        factor: square(),
        inverse: square(),
        alpha: vec![0.0; n],
        theta: [1.0; PARAMETERS],
    };
    let at = [-0.3, 0.2, -0.4, 0.5, 0.1, -1.0];
    posterior.value(&at).unwrap();
    let mut gradient = [0.0; PARAMETERS];
    posterior.gradient(&mut gradient);
    for p in 0..PARAMETERS {
        let mut value = |step: f64| {
            let mut moved = at;
            moved[p] += step;
            posterior.value(&moved).unwrap()
        };
        let slope = (value(1e-5) - value(-1e-5)) / 2e-5;
        assert!((slope - gradient[p]).abs() < 1e-5 * (1.0 + slope.abs()), "{p}: {slope} {}", gradient[p]);
    }
}

/// Against the textbook, in dense algebra of nalgebra's kind by hand: K⁻¹ by the definition of mean and variance at
/// a training point with tiny noise; a file brings the same numbers back.
#[test]
fn predictions_interpolate_are_plain_without_bend_and_come_back_from_a_file() {
    let inputs = rows(25);
    let points = Points::new(&inputs, 3).unwrap();
    let plane: Vec<f64> = inputs.chunks(3).map(|r| 0.2 + 0.7 * r[0] - 0.4 * r[1] + 0.9 * r[2]).collect();
    let bent: Vec<f64> = inputs.chunks(3).map(|r| 0.5 * r[0] * r[2]).collect();
    let mut scratch = GroupedScratch::default();
    for (bends, y) in [(false, &plane), (true, &plane), (true, &bent)] {
        let map = Grouped::fit(points, &[y], options(bends)).unwrap();
        for (row, y) in inputs.chunks(3).zip(y) {
            map.look(row, &mut scratch);
            let (mean, variance) = map.predict(0, &mut scratch, row);
            assert!((mean - y).abs() < 0.05, "{mean} {y}");
            assert!((0.0..0.05).contains(&variance));
        }
        let text = serde_json::to_string(map.saved()).unwrap();
        let back = Grouped::try_from(serde_json::from_str::<SavedGrouped>(&text).unwrap()).unwrap();
        let z = [0.3, -0.2, 0.1];
        back.look(&z, &mut scratch);
        let again = back.predict(0, &mut scratch, &z);
        map.look(&z, &mut scratch);
        assert_eq!(again, map.predict(0, &mut scratch, &z));
    }
}
