//! Why a command failed, and the exit code that says whose fault it was.

use std::process::ExitCode;

use stridemap_lab::LabError;

/// Why a command failed.
#[derive(Debug)]
pub enum Failure {
    /// The request was wrong; nothing was written. Exit code 2.
    Request(anyhow::Error),
    /// It went wrong while working. Exit code 1.
    Working(anyhow::Error),
}

impl Failure {
    /// A wrong request, in words.
    pub fn request(message: impl Into<String>) -> Self {
        Self::Request(anyhow::Error::msg(message.into()))
    }

    /// Something that went wrong while working, in words.
    pub fn working(message: impl Into<String>) -> Self {
        Self::Working(anyhow::Error::msg(message.into()))
    }

    /// 2 for a wrong request, 1 otherwise.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Request(_) => ExitCode::from(2),
            Self::Working(_) => ExitCode::from(1),
        }
    }

    /// The error and its causes.
    pub const fn error(&self) -> &anyhow::Error {
        match self {
            Self::Request(error) | Self::Working(error) => error,
        }
    }
}

impl From<LabError> for Failure {
    fn from(error: LabError) -> Self {
        if error.is_request() { Self::Request(error.into()) } else { Self::Working(error.into()) }
    }
}

impl From<stridemap_record::RecordError> for Failure {
    fn from(error: stridemap_record::RecordError) -> Self {
        LabError::from(error).into()
    }
}

impl From<stridemap_report::ReportError> for Failure {
    fn from(error: stridemap_report::ReportError) -> Self {
        Self::Working(error.into())
    }
}

impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        Self::Working(error.into())
    }
}
