//! Protocol buffers, as far as an ONNX file needs them: a message is a list of numbered fields.

use crate::OnnxError;

/// The content of one field.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Value<'a> {
    /// A whole number.
    Varint(u64),
    /// Four bytes.
    Fixed32([u8; 4]),
    /// Text, bytes, packed numbers or a message.
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    pub fn bytes(self) -> Option<&'a [u8]> {
        if let Self::Bytes(bytes) = self { Some(bytes) } else { None }
    }

    pub fn text(self) -> String {
        String::from_utf8_lossy(self.bytes().unwrap_or_default()).into_owned()
    }

    /// A whole number, or a packed list of them.
    pub fn integers(self) -> Result<Vec<i64>, OnnxError> {
        let mut packed = match self {
            Self::Varint(value) => return Ok(vec![value.cast_signed()]),
            Self::Bytes(bytes) => bytes,
            Self::Fixed32(_) => return Err(OnnxError::Broken { what: "a whole number in four bytes" }),
        };
        let mut values = Vec::new();
        while !packed.is_empty() {
            values.push(varint(&mut packed)?.cast_signed());
        }
        Ok(values)
    }

    /// A number in single precision, or a packed list of them.
    pub fn floats(self) -> Vec<f32> {
        match self {
            Self::Fixed32(bytes) => vec![f32::from_le_bytes(bytes)],
            Self::Bytes(bytes) => floats(bytes),
            Self::Varint(_) => Vec::new(),
        }
    }
}

/// Numbers in single precision, little end first.
pub(crate) fn floats(bytes: &[u8]) -> Vec<f32> {
    let (chunks, _) = bytes.as_chunks::<4>();
    chunks.iter().map(|chunk| f32::from_le_bytes(*chunk)).collect()
}

/// Whole numbers of eight bytes, little end first.
pub(crate) fn longs(bytes: &[u8]) -> Vec<i64> {
    let (chunks, _) = bytes.as_chunks::<8>();
    chunks.iter().map(|chunk| i64::from_le_bytes(*chunk)).collect()
}

fn varint(bytes: &mut &[u8]) -> Result<u64, OnnxError> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (first, rest) = bytes.split_first().ok_or(OnnxError::Broken { what: "it ends within a number" })?;
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(OnnxError::Broken { what: "a number of more than 64 bits" })
}

/// Every field of a message: its number and content. Fixed numbers of 64 bits are passed over.
pub(crate) fn fields(mut message: &[u8]) -> Result<Vec<(u64, Value<'_>)>, OnnxError> {
    let mut fields = Vec::new();
    while !message.is_empty() {
        let key = varint(&mut message)?;
        let length = match key & 7 {
            0 => {
                fields.push((key >> 3, Value::Varint(varint(&mut message)?)));
                continue;
            }
            1 => 8,
            2 => usize::try_from(varint(&mut message)?).unwrap_or(usize::MAX),
            5 => 4,
            _ => return Err(OnnxError::Broken { what: "a field of a kind that does not exist" }),
        };
        let (content, rest) =
            message.split_at_checked(length).ok_or(OnnxError::Broken { what: "it ends within a field" })?;
        message = rest;
        match (key & 7, content) {
            (2, bytes) => fields.push((key >> 3, Value::Bytes(bytes))),
            (5, &[a, b, c, d]) => fields.push((key >> 3, Value::Fixed32([a, b, c, d]))),
            _ => {}
        }
    }
    Ok(fields)
}
