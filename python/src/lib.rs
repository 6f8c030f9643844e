//! `stridemap._native`: Stridemap's rooms as Python sees them. It converts arguments and answers; what is computed is
//! computed in the rooms.

mod arrays;
mod error;
mod gp;
mod interrupt;
mod map;
mod parts;
mod plant;
mod policy;
mod run;
mod stride;
mod sweep;
mod table;
mod task;
mod vector;
mod verbs;

use pyo3::prelude::*;

/// Stridemap's native module.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::gp::GpModel;
    #[pymodule_export]
    use crate::map::Map;
    #[pymodule_export]
    use crate::parts::{register_gait, register_learner, register_reward};
    #[pymodule_export]
    use crate::plant::Plant;
    #[pymodule_export]
    use crate::policy::Policy;
    #[pymodule_export]
    use crate::run::{Figure, Run};
    #[pymodule_export]
    use crate::sweep::{sweep, sweep_merge};
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::task::Task;
    #[pymodule_export]
    use crate::vector::MapBatch;
    #[pymodule_export]
    use crate::verbs::{analyse, collect, evaluate, fit, improve, learn, push, resume};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
