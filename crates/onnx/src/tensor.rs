//! Tensors and nodes, as the file has them.

use std::collections::HashMap;

use crate::protobuf::{Value, fields, floats, longs};
use crate::{OnnxError, unknown};

/// An array of numbers: `floats` or, for shapes and places, `longs`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Tensor {
    pub shape: Vec<usize>,
    pub floats: Vec<f32>,
    pub longs: Vec<i64>,
}

impl Tensor {
    /// A row of numbers.
    pub fn row(floats: Vec<f32>) -> Self {
        Self { shape: vec![1, floats.len()], floats, longs: Vec::new() }
    }
}

/// TensorProto: name and content.
pub(crate) fn tensor(message: &[u8]) -> Result<(String, Tensor), OnnxError> {
    let (mut name, mut tensor, mut kind, mut raw) = (String::new(), Tensor::default(), 1, None);
    for (number, value) in fields(message)? {
        match number {
            1 => tensor.shape.extend(value.integers()?.into_iter().map(|n| usize::try_from(n).unwrap_or(0))),
            2 => kind = value.integers()?.first().copied().unwrap_or(0),
            4 => tensor.floats.extend(value.floats()),
            7 => tensor.longs.extend(value.integers()?),
            8 => name = value.text(),
            9 => raw = value.bytes(),
            _ => {}
        }
    }
    match (kind, raw) {
        (1, Some(raw)) => tensor.floats = floats(raw),
        (7, Some(raw)) => tensor.longs = longs(raw),
        (1 | 7, None) => {}
        _ => return Err(unknown(name, format!("has element type {kind}; known are float (1) and int64 (7)"))),
    }
    let expected = tensor.shape.iter().try_fold(1_usize, |all, n| all.checked_mul(*n));
    let found = tensor.floats.len().max(tensor.longs.len());
    if expected != Some(found) {
        return Err(unknown(name, format!("has {found} numbers in the shape {:?}", tensor.shape)));
    }
    Ok((name, tensor))
}

/// An attribute of a node.
#[derive(Clone, Debug, Default)]
pub(crate) struct Attribute {
    pub float: f32,
    pub integer: i64,
    pub integers: Vec<i64>,
    pub tensor: Option<Tensor>,
}

/// One operation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Node {
    pub operator: String,
    pub inputs: Vec<String>,
    pub outputs: Vec<String>,
    pub attributes: HashMap<String, Attribute>,
}

/// NodeProto.
pub(crate) fn node(message: &[u8]) -> Result<Node, OnnxError> {
    let mut node = Node::default();
    for (number, value) in fields(message)? {
        match number {
            1 => node.inputs.push(value.text()),
            2 => node.outputs.push(value.text()),
            4 => node.operator = value.text(),
            5 => {
                let (name, attribute) = attribute(value.bytes().unwrap_or_default())?;
                node.attributes.insert(name, attribute);
            }
            _ => {}
        }
    }
    Ok(node)
}

fn attribute(message: &[u8]) -> Result<(String, Attribute), OnnxError> {
    let (mut name, mut attribute) = (String::new(), Attribute::default());
    for (number, value) in fields(message)? {
        match number {
            1 => name = value.text(),
            2 => attribute.float = value.floats().first().copied().unwrap_or(0.0),
            3 => attribute.integer = value.integers()?.first().copied().unwrap_or(0),
            5 => attribute.tensor = Some(tensor(value.bytes().unwrap_or_default())?.1),
            8 => attribute.integers.extend(value.integers()?),
            _ => {}
        }
    }
    Ok((name, attribute))
}

/// ValueInfoProto: name, and the last dimension, 0 where the file leaves it open.
pub(crate) fn width(message: &[u8]) -> Result<(String, usize), OnnxError> {
    let inner = |message: &[u8], number: u64| -> Result<Vec<u8>, OnnxError> {
        let found = fields(message)?.into_iter().find(|(n, _)| *n == number);
        Ok(found.and_then(|(_, value)| value.bytes()).unwrap_or_default().to_vec())
    };
    let name = fields(message)?.into_iter().find(|(n, _)| *n == 1).map(|(_, value)| value.text());
    // type . tensor_type . shape . dim . dim_value
    let shape = inner(&inner(&inner(message, 2)?, 1)?, 2)?;
    let mut last = 0;
    for (_, dimension) in fields(&shape)? {
        let size = fields(dimension.bytes().unwrap_or_default())?.into_iter().find(|(n, _)| *n == 1);
        last = match size {
            Some((_, Value::Varint(n))) => usize::try_from(n).unwrap_or(0),
            _ => 0,
        };
    }
    Ok((name.unwrap_or_default(), last))
}
