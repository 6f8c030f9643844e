//! Loading a network, and one row of numbers through it.

use std::collections::HashMap;

use crate::protobuf::fields;
use crate::tensor::{Node, Tensor, node, tensor, width};
use crate::{OnnxError, unknown};

/// A network with one row in and one row out.
#[derive(Clone, Debug)]
pub struct Model {
    steps: Vec<Step>,
    /// Constants, the input and what the steps write, by place.
    values: Vec<Tensor>,
    input: usize,
    output: usize,
    inputs: usize,
    outputs: usize,
    metadata: HashMap<String, String>,
}

#[derive(Clone, Debug)]
struct Step {
    name: String,
    operator: Operator,
    inputs: Vec<usize>,
    output: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Operator {
    Gemm,
    /// A function of each number.
    Map(Function),
    /// A function of two numbers, for each pair of a row; one side may be a single number.
    Pair(Function),
    Mean,
    Concat,
    Slice,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Function {
    Elu(f32),
    Relu,
    Tanh,
    Sigmoid,
    Sqrt,
    Softplus,
    Identity,
    Add,
    Sub,
    Mul,
    Div,
    Pow,
}

impl Function {
    fn of(self, x: f32, y: f32) -> f32 {
        match self {
            Self::Elu(alpha) => {
                if x > 0.0 {
                    x
                } else {
                    alpha * x.exp_m1()
                }
            }
            Self::Relu => x.max(0.0),
            Self::Tanh => x.tanh(),
            Self::Sigmoid => 1.0 / (1.0 + (-x).exp()),
            Self::Sqrt => x.sqrt(),
            Self::Softplus => x.exp().ln_1p(),
            Self::Identity => x,
            Self::Add => x + y,
            Self::Sub => x - y,
            Self::Mul => x * y,
            Self::Div => x / y,
            Self::Pow => x.powf(y),
        }
    }
}

impl Model {
    /// Reads a file's bytes.
    ///
    /// # Errors
    ///
    /// [`OnnxError`]: broken bytes; an operator, element type or shape that is not known; more than one input or output.
    pub fn parse(bytes: &[u8]) -> Result<Self, OnnxError> {
        let (mut graph, mut metadata) = (None, HashMap::new());
        for (number, value) in fields(bytes)? {
            match number {
                7 => graph = value.bytes(),
                14 => {
                    let pair = fields(value.bytes().unwrap_or_default())?;
                    let of =
                        |number| pair.iter().find(|(n, _)| *n == number).map(|(_, v)| v.text()).unwrap_or_default();
                    metadata.insert(of(1), of(2));
                }
                _ => {}
            }
        }
        let mut model = Self::graph(graph.ok_or(OnnxError::Broken { what: "it holds no graph" })?)?;
        model.metadata = metadata;
        // A first run finds every fault of the shapes, and how many numbers come out.
        let row = model.run(&vec![0.0; model.inputs])?;
        model.outputs = row.len();
        Ok(model)
    }

    fn graph(message: &[u8]) -> Result<Self, OnnxError> {
        let (mut nodes, mut named, mut ins, mut outs) = (Vec::new(), HashMap::new(), Vec::new(), Vec::new());
        let mut values = Vec::new();
        for (number, value) in fields(message)? {
            let bytes = value.bytes().unwrap_or_default();
            match number {
                1 => {
                    let mut node = node(bytes)?;
                    if node.operator == "Constant" {
                        let constant = node.attributes.remove("value").and_then(|a| a.tensor);
                        let constant = constant.ok_or_else(|| unknown("Constant", "holds no tensor"))?;
                        named.insert(node.outputs.pop().unwrap_or_default(), values.len());
                        values.push(constant);
                    } else {
                        nodes.push(node);
                    }
                }
                5 => {
                    let (name, tensor) = tensor(bytes)?;
                    named.insert(name, values.len());
                    values.push(tensor);
                }
                11 => ins.push(width(bytes)?),
                12 => outs.push(width(bytes)?),
                _ => {}
            }
        }
        let only = |of: &[(String, usize)], what: &str| match of {
            [(name, width)] => Ok((name.clone(), *width)),
            _ => Err(unknown("graph", format!("has {} {what}; known are networks with one", of.len()))),
        };
        // Files of older makers list their constants among the inputs.
        ins.retain(|(name, _)| !named.contains_key(name));
        let (input_name, inputs) = only(&ins, "inputs")?;
        let (output_name, _) = only(&outs, "outputs")?;
        if inputs == 0 {
            return Err(unknown(input_name, "does not say how many numbers it takes"));
        }
        values.push(Tensor::default());
        let input = values.len() - 1;
        named.insert(input_name, input);
        let mut steps = Vec::new();
        for node in &nodes {
            let [output] = node.outputs.as_slice() else {
                return Err(unknown(&node.operator, format!("has {} outputs", node.outputs.len())));
            };
            let known = |name: &String| {
                named
                    .get(name)
                    .copied()
                    .ok_or_else(|| unknown(&node.operator, format!("reads {name:?}, which nothing makes")))
            };
            let used = node.inputs.iter().filter(|name| !name.is_empty()).map(known).collect::<Result<_, _>>()?;
            values.push(Tensor::default());
            named.insert(output.clone(), values.len() - 1);
            let (name, operator) = (node.operator.clone(), operator(node)?);
            steps.push(Step { name, operator, inputs: used, output: values.len() - 1 });
        }
        let output = named.get(&output_name).copied();
        let output = output.ok_or_else(|| unknown(output_name, "is an output that nothing makes"))?;
        Ok(Self { steps, values, input, output, inputs, outputs: 0, metadata: HashMap::new() })
    }

    /// Numbers that go in.
    #[must_use]
    pub const fn inputs(&self) -> usize {
        self.inputs
    }

    /// Numbers that come out.
    #[must_use]
    pub const fn outputs(&self) -> usize {
        self.outputs
    }

    /// What the file says under a key beside the network.
    #[must_use]
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    /// The keys of [`metadata`](Self::metadata), in order.
    #[must_use]
    pub fn metadata_keys(&self) -> Vec<&str> {
        let mut keys: Vec<&str> = self.metadata.keys().map(String::as_str).collect();
        keys.sort_unstable();
        keys
    }

    /// One row through the network.
    ///
    /// # Errors
    ///
    /// [`OnnxError::Inputs`] for a row of another length; [`OnnxError::Unknown`] for a shape that is not known, which
    /// [`parse`](Self::parse) finds first.
    pub fn run(&self, row: &[f32]) -> Result<Vec<f32>, OnnxError> {
        if row.len() != self.inputs {
            return Err(OnnxError::Inputs { expected: self.inputs, found: row.len() });
        }
        let mut made: Vec<Option<Tensor>> = vec![None; self.values.len()];
        made[self.input] = Some(Tensor::row(row.to_vec()));
        for step in &self.steps {
            let inputs: Vec<&Tensor> =
                step.inputs.iter().map(|&at| made[at].as_ref().unwrap_or(&self.values[at])).collect();
            let out = step.apply(&inputs)?;
            made[step.output] = Some(out);
        }
        Ok(made[self.output].take().unwrap_or_default().floats)
    }
}

/// The operation of a node, its attributes checked.
fn operator(node: &Node) -> Result<Operator, OnnxError> {
    let name = node.operator.as_str();
    let attribute = |key: &str| node.attributes.get(key);
    let number = |key: &str, default: f32| attribute(key).map_or(default, |a| a.float);
    Ok(match name {
        "Gemm" => {
            let flag = |key: &str| attribute(key).is_some_and(|a| a.integer != 0);
            let one = |key: &str| (number(key, 1.0) - 1.0).abs() < 1e-9;
            if flag("transA") || !flag("transB") || !one("alpha") || !one("beta") {
                return Err(unknown(name, "is known as x Wt + b alone (transB = 1)"));
            }
            Operator::Gemm
        }
        "Elu" => Operator::Map(Function::Elu(number("alpha", 1.0))),
        "Relu" => Operator::Map(Function::Relu),
        "Tanh" => Operator::Map(Function::Tanh),
        "Sigmoid" => Operator::Map(Function::Sigmoid),
        "Sqrt" => Operator::Map(Function::Sqrt),
        "Softplus" => Operator::Map(Function::Softplus),
        "Identity" => Operator::Map(Function::Identity),
        "Add" => Operator::Pair(Function::Add),
        "Sub" => Operator::Pair(Function::Sub),
        "Mul" => Operator::Pair(Function::Mul),
        "Div" => Operator::Pair(Function::Div),
        "Pow" => Operator::Pair(Function::Pow),
        "ReduceMean" => match attribute("axes").map(|a| a.integers.as_slice()) {
            Some([-1 | 1]) => Operator::Mean,
            axes => return Err(unknown(name, format!("over the axes {axes:?}; known is the last alone"))),
        },
        "Concat" => Operator::Concat,
        "Slice" => Operator::Slice,
        _ => return Err(unknown(name, "is an operator that is not known here")),
    })
}

impl Step {
    fn apply(&self, inputs: &[&Tensor]) -> Result<Tensor, OnnxError> {
        let input = |at: usize| inputs.get(at).copied().ok_or_else(|| unknown(&self.name, format!("lacks input {at}")));
        let x = input(0)?;
        Ok(match self.operator {
            Operator::Map(function) => Tensor::row(x.floats.iter().map(|x| function.of(*x, 0.0)).collect()),
            Operator::Pair(function) => {
                let (a, b) = (&x.floats, &input(1)?.floats);
                match (a.as_slice(), b.as_slice()) {
                    (_, [y]) => Tensor::row(a.iter().map(|x| function.of(*x, *y)).collect()),
                    ([x], _) => Tensor::row(b.iter().map(|y| function.of(*x, *y)).collect()),
                    _ if a.len() == b.len() => Tensor::row(a.iter().zip(b).map(|(x, y)| function.of(*x, *y)).collect()),
                    _ => return Err(unknown(&self.name, format!("of {} and {} numbers", a.len(), b.len()))),
                }
            }
            Operator::Gemm => self.gemm(&x.floats, input(1)?, &input(2)?.floats)?,
            Operator::Mean => Tensor::row(vec![x.floats.iter().sum::<f32>() / x.floats.len().max(1) as f32]),
            Operator::Concat => Tensor::row(inputs.iter().flat_map(|x| x.floats.iter().copied()).collect()),
            Operator::Slice => self.slice(inputs)?,
        })
    }

    /// `x Wᵀ + b`, summed in sixteen lanes so that the compiler can use vectors; the order is fixed.
    fn gemm(&self, x: &[f32], weights: &Tensor, bias: &[f32]) -> Result<Tensor, OnnxError> {
        let &[rows, columns] = weights.shape.as_slice() else {
            return Err(unknown(&self.name, format!("with weights of the shape {:?}", weights.shape)));
        };
        if columns != x.len() || rows != bias.len() || columns == 0 {
            let what = format!("of {} numbers with weights {rows} x {columns} and {} biases", x.len(), bias.len());
            return Err(unknown(&self.name, what));
        }
        let dot = |row: &[f32]| {
            let mut lanes = [0.0_f32; 16];
            let ((a, x_rest), (b, row_rest)) = (x.as_chunks::<16>(), row.as_chunks::<16>());
            for (a, b) in a.iter().zip(b) {
                for (lane, (a, b)) in lanes.iter_mut().zip(a.iter().zip(b)) {
                    *lane += a * b;
                }
            }
            let rest: f32 = x_rest.iter().zip(row_rest).map(|(a, b)| a * b).sum();
            rest + lanes.iter().sum::<f32>()
        };
        Ok(Tensor::row(weights.floats.chunks_exact(columns).zip(bias).map(|(row, b)| b + dot(row)).collect()))
    }

    /// Some columns of a row.
    fn slice(&self, inputs: &[&Tensor]) -> Result<Tensor, OnnxError> {
        let fault = || unknown(&self.name, "is known for columns of a row alone, step 1");
        let [x, from, to, rest @ ..] = inputs else { return Err(fault()) };
        let one = |tensor: &Tensor| tensor.longs.first().copied().filter(|_| tensor.longs.len() == 1);
        let axes_ok = rest.first().is_some_and(|axes| matches!(axes.longs.as_slice(), [1 | -1]));
        let step_ok = rest.get(1).is_none_or(|step| step.longs == [1]);
        let (Some(from), Some(to), true, true) = (one(from), one(to), axes_ok, step_ok) else { return Err(fault()) };
        let length = i64::try_from(x.floats.len()).unwrap_or(i64::MAX);
        let place = |at: i64| usize::try_from(if at < 0 { at + length } else { at }.clamp(0, length)).unwrap_or(0);
        Ok(Tensor::row(x.floats.get(place(from)..place(to)).ok_or_else(fault)?.to_vec()))
    }
}
