//! Small feed-forward networks in ONNX files: a reader and an interpreter.
//!
//! A walking policy is asked 50 times a second, and takes a hundred numbers in and thirty out: two files of plain code
//! do that in tens of microseconds (measured beside `rten`, `tract` and onnxruntime: docs/pretrained.md), where a library
//! costs the user's first build a minute or more. An operator, an element type or a shape that is not known here by name is
//! refused when the file is loaded.
//!
//! ```
//! use stridemap_onnx::{Model, write};
//!
//! // y = relu(x W' + b), with W = [[1, -1], [2, 0]], b = [0.5, -3].
//! let bytes = write::mlp(&[write::Layer { weights: vec![vec![1.0, -1.0], vec![2.0, 0.0]], bias: vec![0.5, -3.0] }],
//!     "Relu", true, &[("kp", "[40.0]")]);
//! let model = Model::parse(&bytes)?;
//! assert_eq!((model.inputs(), model.outputs()), (2, 2));
//! assert_eq!(model.run(&[3.0, 1.0])?, [2.5, 3.0]);
//! assert_eq!(model.metadata("kp"), Some("[40.0]"));
//! # Ok::<(), stridemap_onnx::OnnxError>(())
//! ```

mod protobuf;
mod run;
mod tensor;
pub mod write;

pub use run::Model;

/// Why a file is not a network that can be run here.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OnnxError {
    /// The bytes are no ONNX file, or are cut off.
    #[error("is no whole ONNX file: {what}")]
    Broken {
        /// What was found.
        what: &'static str,
    },
    /// The file asks for something that is not known here.
    #[error("{node}: {what}")]
    Unknown {
        /// Operator, or tensor, at fault.
        node: String,
        /// What is not known of it.
        what: String,
    },
    /// The network was given a wrong number of inputs.
    #[error("takes {expected} numbers and was given {found}")]
    Inputs {
        /// Numbers that it takes.
        expected: usize,
        /// Numbers given.
        found: usize,
    },
}

pub(crate) fn unknown(node: impl Into<String>, what: impl Into<String>) -> OnnxError {
    OnnxError::Unknown { node: node.into(), what: what.into() }
}
