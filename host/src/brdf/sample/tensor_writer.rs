//! The header of tensor files that are written; see [`super::tensor_file`] for the layout.

#[cfg(test)]
pub(super) use whole::{Data, Field, write};

/// Types of elements that are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Bytes.
    U8,
    /// Half precision.
    #[cfg(test)]
    F16,
    /// Single precision.
    F32,
    /// Double precision.
    #[cfg(test)]
    F64,
}

impl Kind {
    /// Its number in the file.
    const fn code(self) -> u8 {
        match self {
            Self::U8 => 1,
            #[cfg(test)]
            Self::F16 => 9,
            Self::F32 => 10,
            #[cfg(test)]
            Self::F64 => 11,
        }
    }
}

/// Name, shape, type and bytes of the data of a field; the shape is written as it is, right or wrong.
pub(crate) type Head<'a> = (&'a str, &'a [u64], Kind, u64);

/// The header of a file with these fields, and how many zeros stand before the data of each, which follow in this order: data begin at
/// multiples of 8.
pub(crate) fn header(fields: &[Head]) -> (Vec<u8>, Vec<usize>) {
    let mut header = b"tensor_file\0\x01\x00".to_vec();
    header.extend((fields.len() as u32).to_le_bytes());
    let sizes = fields
        .iter()
        .map(|(name, shape, ..)| 13 + name.len() + 8 * shape.len());
    let mut end = (18 + sizes.sum::<usize>()) as u64;
    let mut gaps = Vec::with_capacity(fields.len());
    for (name, shape, kind, bytes) in fields {
        let offset = end.next_multiple_of(8);
        gaps.push((offset - end) as usize);
        header.extend((name.len() as u16).to_le_bytes());
        header.extend(name.as_bytes());
        header.extend((shape.len() as u16).to_le_bytes());
        header.push(kind.code());
        header.extend(offset.to_le_bytes());
        header.extend(shape.iter().flat_map(|n| n.to_le_bytes()));
        end = offset + bytes;
    }
    (header, gaps)
}

/// Whole files, for tests.
#[cfg(test)]
mod whole {
    use half::f16;

    use super::{Kind, header};

    /// Data of one field.
    #[derive(Debug, Clone, Copy)]
    pub(in crate::brdf::sample) enum Data<'a> {
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
        const fn kind(&self) -> Kind {
            match self {
                Data::U8(_) => Kind::U8,
                Data::F16(_) => Kind::F16,
                Data::F32(_) => Kind::F32,
                Data::F64(_) => Kind::F64,
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

    /// Name, shape and data of a field.
    pub(in crate::brdf::sample) type Field<'a> = (&'a str, &'a [u64], Data<'a>);

    /// The bytes of a tensor file with these fields.
    pub(in crate::brdf::sample) fn write(fields: &[Field]) -> Vec<u8> {
        let data: Vec<Vec<u8>> = fields.iter().map(|(.., data)| data.bytes()).collect();
        let heads: Vec<_> = fields
            .iter()
            .zip(&data)
            .map(|((name, shape, values), data)| (*name, *shape, values.kind(), data.len() as u64))
            .collect();
        let (mut file, gaps) = header(&heads);
        for (data, gap) in data.iter().zip(gaps) {
            file.resize(file.len() + gap, 0);
            file.extend(data);
        }
        file
    }
}
