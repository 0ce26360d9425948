//! Writes tensor files for tests; see [`super::tensor_file`] for the layout.

use half::f16;

/// Data of one field.
#[derive(Debug, Clone, Copy)]
pub(super) enum Data<'a> {
    /// Bytes.
    U8(&'a [u8]),
    /// Converted to half precision.
    F16(&'a [f32]),
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl Data<'_> {
    fn dtype(&self) -> u8 {
        match self {
            Data::U8(_) => 1,
            Data::F16(_) => 9,
            Data::F32(_) => 10,
            Data::F64(_) => 11,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Data::U8(values) => values.to_vec(),
            Data::F16(values) => values
                .iter()
                .flat_map(|v| f16::from_f32(*v).to_le_bytes())
                .collect(),
            Data::F32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Data::F64(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

/// Name, shape and data of a field; the shape is written as it is, right or wrong.
pub(super) type Field<'a> = (&'a str, &'a [u64], Data<'a>);

/// The bytes of a tensor file with these fields.
pub(super) fn write(fields: &[Field]) -> Vec<u8> {
    let mut header = b"tensor_file\0\x01\x00".to_vec();
    header.extend((fields.len() as u32).to_le_bytes());
    let header_bytes: usize = 18
        + fields
            .iter()
            .map(|(n, shape, _)| 13 + n.len() + 8 * shape.len())
            .sum::<usize>();
    let mut data = Vec::new();
    for (name, shape, values) in fields {
        data.resize((header_bytes + data.len()).next_multiple_of(8) - header_bytes, 0);
        header.extend((name.len() as u16).to_le_bytes());
        header.extend(name.as_bytes());
        header.extend((shape.len() as u16).to_le_bytes());
        header.push(values.dtype());
        header.extend(((header_bytes + data.len()) as u64).to_le_bytes());
        header.extend(shape.iter().flat_map(|n| n.to_le_bytes()));
        data.extend(values.bytes());
    }
    header.extend(data);
    header
}
