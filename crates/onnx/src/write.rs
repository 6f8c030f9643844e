//! Writes small ONNX files: policies of one's own, and networks for tests.

/// One layer, `y = f(x Wᵀ + b)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// A row for each number that comes out.
    pub weights: Vec<Vec<f32>>,
    /// A number for each row.
    pub bias: Vec<f32>,
}

/// The bytes of a network of layers with an activation (`"Elu"`, `"Relu"`, `"Tanh"`) after each; after the last only where
/// `activate_last` says so. `metadata` are keys and texts beside it.
#[must_use]
pub fn mlp(layers: &[Layer], activation: &str, activate_last: bool, metadata: &[(&str, &str)]) -> Vec<u8> {
    let mut graph = Vec::new();
    let mut from = "obs".to_owned();
    for (i, layer) in layers.iter().enumerate() {
        let last = i + 1 == layers.len();
        let out = |kind: &str, is_last: bool| if is_last { "action".to_owned() } else { format!("{kind}{i}") };
        let columns = layer.weights.first().map_or(0, Vec::len);
        let (weights, bias) = (format!("w{i}"), format!("b{i}"));
        let flat: Vec<f32> = layer.weights.iter().flatten().copied().collect();
        message(&mut graph, 5, &tensor(&weights, &[layer.weights.len(), columns], &flat));
        message(&mut graph, 5, &tensor(&bias, &[layer.bias.len()], &layer.bias));
        let activated = !last || activate_last;
        let sum = out("sum", last && !activated);
        let mut gemm = node("Gemm", &[&from, &weights, &bias], &sum);
        let mut trans_b = Vec::new();
        message(&mut trans_b, 1, b"transB");
        number(&mut trans_b, 3, 1);
        number(&mut trans_b, 20, 2);
        message(&mut gemm, 5, &trans_b);
        message(&mut graph, 1, &gemm);
        from = sum;
        if activated {
            let y = out("y", last);
            message(&mut graph, 1, &node(activation, &[&from], &y));
            from = y;
        }
    }
    let widths = [
        ("obs", 11, layers.first().map_or(0, |layer| layer.weights.first().map_or(0, Vec::len))),
        ("action", 12, layers.last().map_or(0, |layer| layer.bias.len())),
    ];
    for (name, field, width) in widths {
        message(&mut graph, field, &value(name, width));
    }
    let mut model = Vec::new();
    number(&mut model, 1, 8);
    message(&mut model, 7, &graph);
    for (key, text) in metadata {
        let mut pair = Vec::new();
        message(&mut pair, 1, key.as_bytes());
        message(&mut pair, 2, text.as_bytes());
        message(&mut model, 14, &pair);
    }
    model
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value > 0x7f {
        out.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn number(out: &mut Vec<u8>, field: u64, value: u64) {
    varint(out, field << 3);
    varint(out, value);
}

fn message(out: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    varint(out, field << 3 | 2);
    varint(out, bytes.len() as u64);
    out.extend_from_slice(bytes);
}

fn tensor(name: &str, shape: &[usize], floats: &[f32]) -> Vec<u8> {
    let mut out = Vec::new();
    for size in shape {
        number(&mut out, 1, *size as u64);
    }
    number(&mut out, 2, 1);
    message(&mut out, 8, name.as_bytes());
    let bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    message(&mut out, 9, &bytes);
    out
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let mut out = Vec::new();
    for input in inputs {
        message(&mut out, 1, input.as_bytes());
    }
    message(&mut out, 2, output.as_bytes());
    message(&mut out, 4, operator.as_bytes());
    out
}

fn value(name: &str, width: usize) -> Vec<u8> {
    let mut shape = Vec::new();
    for size in [1, width] {
        let mut dimension = Vec::new();
        number(&mut dimension, 1, size as u64);
        message(&mut shape, 1, &dimension);
    }
    let (mut tensor_type, mut kind, mut out) = (Vec::new(), Vec::new(), Vec::new());
    number(&mut tensor_type, 1, 1);
    message(&mut tensor_type, 2, &shape);
    message(&mut kind, 1, &tensor_type);
    message(&mut out, 1, name.as_bytes());
    message(&mut out, 2, &kind);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Model, OnnxError};

    fn layer(rows: usize, columns: usize) -> Layer {
        let weight = |i: usize, j: usize| ((i * 7 + j * 3) as f32 * 0.37).sin();
        Layer {
            weights: (0..rows).map(|i| (0..columns).map(|j| weight(i, j)).collect()).collect(),
            bias: (0..rows).map(|i| (i as f32).cos()).collect(),
        }
    }

    /// Two layers of odd widths against the sums written out, in double precision.
    #[test]
    fn a_network_computes_what_its_layers_say() {
        let layers = [layer(21, 37), layer(5, 21)];
        let model = Model::parse(&mlp(&layers, "Elu", false, &[])).unwrap();
        let x: Vec<f32> = (0..37).map(|i| (i as f32 * 0.11).cos()).collect();
        let dot = |layer: &Layer, x: &[f64]| -> Vec<f64> {
            layer
                .weights
                .iter()
                .zip(&layer.bias)
                .map(|(row, b)| f64::from(*b) + row.iter().zip(x).map(|(w, x)| f64::from(*w) * x).sum::<f64>())
                .collect()
        };
        let hidden = dot(&layers[0], &x.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
        let hidden: Vec<f64> = hidden.into_iter().map(|v| if v > 0.0 { v } else { v.exp() - 1.0 }).collect();
        let expected = dot(&layers[1], &hidden);
        for (found, expected) in model.run(&x).unwrap().iter().zip(&expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-5, "{found} {expected}");
        }
        assert!(matches!(model.run(&x[1..]), Err(OnnxError::Inputs { expected: 37, found: 36 })));
    }

    #[test]
    fn what_is_not_known_is_refused_by_name() {
        let error = Model::parse(&mlp(&[layer(2, 2)], "Swish", true, &[])).unwrap_err();
        assert!(error.to_string().contains("Swish: is an operator that is not known"), "{error}");
        let mismatched = [layer(3, 2), layer(2, 4)];
        let error = Model::parse(&mlp(&mismatched, "Relu", true, &[])).unwrap_err();
        assert!(error.to_string().contains("Gemm: of 3 numbers with weights 2 x 4"), "{error}");
    }

    /// A file that is cut anywhere is refused or, where only metadata are lost, whole; nothing panics.
    #[test]
    fn a_file_that_is_cut_is_told() {
        let bytes = mlp(&[layer(3, 4)], "Tanh", true, &[("kp", "[1.0]")]);
        for end in 0..bytes.len() {
            let _ = Model::parse(&bytes[..end]);
        }
        assert!(Model::parse(&bytes[..bytes.len() / 2]).is_err());
        assert!(matches!(Model::parse(&[]), Err(OnnxError::Broken { .. })));
    }
}
