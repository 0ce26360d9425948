//! A tiny writer of tensor files (`.bsdf`), honest or not.

/// One field; `offset` overrides where its data are said to be.
pub(crate) struct Field {
    pub(crate) name: &'static str,
    pub(crate) dtype: u8,
    pub(crate) shape: Vec<u64>,
    pub(crate) offset: Option<u64>,
    pub(crate) data: Vec<u8>,
}

const U8: u8 = 1;
const F32: u8 = 10;

fn field(name: &'static str, shape: &[u64], values: &[f32]) -> Field {
    Field {
        name,
        dtype: F32,
        shape: shape.to_vec(),
        offset: None,
        data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
    }
}

/// Fields of a material whose f·cosθo is `level` everywhere.
pub(crate) fn material(level: f32) -> Vec<Field> {
    vec![
        field("phi_i", &[1], &[0.0]),
        field("theta_i", &[2], &[0.0, std::f32::consts::FRAC_PI_2]),
        // With these three the look-up is the identity and the factor in front of it 1.
        field("ndf", &[2, 2], &[1.0; 4]),
        field("sigma", &[2, 2], &[0.25; 4]),
        field("vndf", &[1, 2, 2, 2], &[1.0; 8]),
        field("rgb", &[1, 2, 3, 2, 2], &[level; 24]),
        Field {
            name: "jacobian",
            dtype: U8,
            shape: vec![1],
            offset: None,
            data: vec![1],
        },
    ]
}

/// As [`material`], with spectra every 50 nm from 400 to 700 nm, which are `level` and grow by `slope` of it from end to end.
pub(crate) fn spectral(level: f32, slope: f32) -> Vec<Field> {
    let mut fields = material(level);
    fields.retain(|field| field.name != "rgb");
    let shares: Vec<f32> = (0..7_u8).map(|n| f32::from(n) / 6.0).collect();
    let wavelengths: Vec<f32> = shares
        .iter()
        .map(|share| 300.0_f32.mul_add(*share, 400.0))
        .collect();
    let one: Vec<f32> = shares
        .iter()
        .flat_map(|share| [level * (1.0 + slope * share); 4])
        .collect();
    fields.push(field("spectra", &[1, 2, 7, 2, 2], &[one.clone(), one].concat()));
    fields.push(field("wavelengths", &[7], &wavelengths));
    fields
}

/// The field of `fields` with this name.
pub(crate) fn named<'a>(fields: &'a mut [Field], name: &str) -> &'a mut Field {
    let found = fields.iter_mut().find(|field| field.name == name);
    found.expect("the material has this field")
}

/// The bytes of a file with `fields`, their data aligned to 8 bytes.
pub(crate) fn bytes(fields: &[Field]) -> Vec<u8> {
    let mut header = b"tensor_file\0\x01\x00".to_vec();
    header.extend((fields.len() as u32).to_le_bytes());
    let entry = |field: &Field| 2 + field.name.len() + 2 + 1 + 8 + 8 * field.shape.len();
    let start = header.len() + fields.iter().map(entry).sum::<usize>();
    let mut data = Vec::new();
    for field in fields {
        data.resize((start + data.len()).next_multiple_of(8) - start, 0);
        header.extend((field.name.len() as u16).to_le_bytes());
        header.extend(field.name.as_bytes());
        header.extend((field.shape.len() as u16).to_le_bytes());
        header.push(field.dtype);
        header.extend(field.offset.unwrap_or((start + data.len()) as u64).to_le_bytes());
        header.extend(field.shape.iter().flat_map(|length| length.to_le_bytes()));
        data.extend(&field.data);
    }
    header.extend(data);
    header
}
