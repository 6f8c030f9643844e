//! Saved models: a versioned JSON form whose predictions are bit-identical to the original's.
//!
//! What is saved is what determines the model: kernel, mean, hyperparameters, the frame and the
//! data. Reading repeats the conditioning, which gives the same bits on the same kind of
//! processor. A model that was updated point by point saves its factor as well, because
//! conditioning anew would round differently. A checksum over all numbers finds a changed digit.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::{GpError, Result, check_finite, check_len};
use crate::gp::{Gp, check_data};
use crate::hyper::Hyperparameters;
use crate::kernel::Kernel;
use crate::mean::{Frame, Mean};
use crate::optimize::FitReport;
use crate::panels::InverseFactor;
use crate::points::Points;
use crate::scores::LeaveOneOutScores;

/// Format of one saved model.
const FORMAT: &str = "stridemap-gp";
/// Version of the format that is written and read.
pub(crate) const VERSION: u32 = 1;

/// The saved form of a [`Gp`].
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedGp {
    format: String,
    version: u32,
    kernel: Kernel,
    mean: Mean,
    hyperparameters: Hyperparameters,
    mean_coefficients: Vec<f64>,
    log_marginal_likelihood: f64,
    leave_one_out: Option<LeaveOneOutScores>,
    report: Option<FitReport>,
    offset: f64,
    centre: Vec<f64>,
    spread: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    targets: Vec<f64>,
    updates: usize,
    factor: Option<Vec<f64>>,
    checksum: String,
}

#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl SavedGp {
    /// Checksum of every number that determines the model.
    fn digest(&self) -> String {
        let h = &self.hyperparameters;
        let scalars = [h.signal_variance, h.noise_variance, self.offset];
        let factor = self.factor.iter().flatten();
        let rows = self.inputs.iter().flatten();
        let vectors = h.length_scales.iter().chain(&self.centre).chain(&self.spread);
        let numbers = scalars.iter().chain(vectors).chain(rows).chain(&self.targets).chain(factor);
        digest_of([self.kernel as u64, self.mean as u64, self.updates as u64], numbers)
    }
}

/// FNV-1a over whole numbers and the bits of real ones.
pub(crate) fn digest_of<'a>(whole: [u64; 3], numbers: impl Iterator<Item = &'a f64>) -> String {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for bits in whole.into_iter().chain(numbers.map(|number| number.to_bits())) {
        for byte in bits.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    format!("{hash:016x}")
}

impl From<Gp> for SavedGp {
    fn from(gp: Gp) -> Self {
        let mut saved = Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            kernel: gp.kernel,
            mean: gp.mean,
            mean_coefficients: gp.mean_coefficients(),
            log_marginal_likelihood: gp.log_marginal_likelihood,
            leave_one_out: gp.leave_one_out().ok().map(|loo| loo.scores()),
            offset: gp.offset,
            inputs: gp.x.chunks_exact(gp.dims).map(<[f64]>::to_vec).collect(),
            updates: gp.updates,
            factor: (gp.updates > 0).then(|| gp.factor.entries_slice().to_vec()),
            hyperparameters: gp.hyperparameters,
            report: gp.report,
            centre: gp.frame.centre,
            spread: gp.frame.spread,
            targets: gp.y,
            checksum: String::new(),
        };
        saved.checksum = saved.digest();
        saved
    }
}

pub(crate) fn check_header(format: &str, version: u32, expected: &str) -> Result<()> {
    if format == expected && version == VERSION {
        return Ok(());
    }
    Err(GpError::Format {
        expected: format!("{expected} version {VERSION}"),
        found: format!("{format} version {version}"),
    })
}

/// Checks the header alone, so that another version is told from a fault.
pub(crate) fn check_text(text: &str, expected: &str) -> Result<()> {
    let header: Header = parse(text)?;
    check_header(&header.format, header.version, expected)
}

impl TryFrom<SavedGp> for Gp {
    type Error = GpError;

    fn try_from(saved: SavedGp) -> Result<Self> {
        check_header(&saved.format, saved.version, FORMAT)?;
        let found = saved.digest();
        if found != saved.checksum {
            let expected = saved.checksum;
            return Err(GpError::Corrupt { what: "checksum", expected, found });
        }
        let dims = saved.hyperparameters.length_scales.len();
        for row in &saved.inputs {
            check_len("length of an input", dims, row.len())?;
        }
        check_len("centre", dims, saved.centre.len())?;
        check_len("spread", dims, saved.spread.len())?;
        check_finite("centre", &saved.centre, 1)?;
        check_finite("spread", &saved.spread, 1)?;
        check_finite("offset", &[saved.offset], 1)?;
        let x: Vec<f64> = saved.inputs.concat();
        let points = Points::new(&x, dims)?;
        check_data(points, &saved.targets)?;
        let frame = Frame { centre: saved.centre, spread: saved.spread };
        let mut gp = Self::conditioned(
            points,
            &saved.targets,
            saved.kernel,
            saved.mean,
            saved.hyperparameters,
            saved.offset,
            frame,
        )?;
        if let Some(entries) = saved.factor {
            let n = saved.targets.len();
            let found = entries.len();
            check_finite("factor", &entries, 1)?;
            gp.factor = InverseFactor::from_entries(n, &entries).ok_or(GpError::Corrupt {
                what: "length of the factor",
                expected: format!("that of {n} points"),
                found: found.to_string(),
            })?;
            gp.updates = saved.updates;
            gp.solve()?;
        }
        gp.report = saved.report;
        Ok(gp)
    }
}

impl Serialize for Gp {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        SavedGp::from(self.clone()).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Gp {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        SavedGp::deserialize(deserializer)?.try_into().map_err(serde::de::Error::custom)
    }
}

pub(crate) fn parse<T: for<'a> Deserialize<'a>>(text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|error| GpError::Parse {
        line: error.line(),
        column: error.column(),
        reason: error.to_string(),
    })
}

pub(crate) fn write<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(|error| GpError::Parse {
        line: error.line(),
        column: error.column(),
        reason: error.to_string(),
    })
}

impl Gp {
    /// The model as JSON.
    ///
    /// # Errors
    ///
    /// None in practice: [`GpError::Parse`] if a number cannot be written.
    ///
    /// # Example
    ///
    /// ```
    /// # use stridemap_gp::{Gp, GpError, Hyperparameters, Kernel, Mean, Points};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// # let gp = Gp::condition(Points::new(&[0.0], 1)?, &[1.0],
    /// #     Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// let text = gp.to_json()?;
    /// let again = Gp::from_json(&text)?;
    /// assert_eq!(gp.predict(&[0.3])?, again.predict(&[0.3])?);
    ///
    /// // A changed digit is found.
    /// let changed = text.replace("\"signal_variance\":1.0", "\"signal_variance\":1.5");
    /// assert!(matches!(Gp::from_json(&changed), Err(GpError::Corrupt { what: "checksum", .. })));
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn to_json(&self) -> Result<String> {
        write(self)
    }

    /// Reads a model that [`to_json`](Self::to_json) wrote; predictions are bit-identical on the
    /// same kind of processor.
    ///
    /// # Errors
    ///
    /// [`GpError::Parse`] if the text is cut off or not of this form, [`GpError::Format`] if it is
    /// of another format or version, [`GpError::Corrupt`] if its checksum does not agree; and what
    /// [`Gp::condition`] may return.
    pub fn from_json(text: &str) -> Result<Self> {
        check_text(text, FORMAT)?;
        parse::<SavedGp>(text)?.try_into()
    }
}
