//! The part of a sample specification after the colon: a preset and `key=value` pairs, separated by commas.

use super::SampleError;

/// One parameter of an analytic model.
#[derive(Debug)]
pub(super) struct Parameter {
    /// What stands before the `=`.
    pub(super) key: &'static str,
    /// Smallest allowed value.
    pub(super) min: f64,
    /// Largest allowed value.
    pub(super) max: f64,
}

/// A named set of values, in the order of the model's parameters.
pub(super) type Preset<const N: usize> = (&'static str, [f64; N]);

/// The values of all `parameters` after `arguments` (what follows the colon of `spec`) were applied.
///
/// Starts from the first preset; a preset's name as the first argument starts from that one instead.
pub(super) fn values<const N: usize>(
    spec: &str,
    arguments: Option<&str>,
    parameters: &[Parameter; N],
    presets: &[Preset<N>],
) -> Result<[f64; N], SampleError> {
    let mut values = presets
        .first()
        .expect("invariant: every model has a default preset")
        .1;
    let mut given = [false; N];
    let Some(arguments) = arguments else {
        return Ok(values);
    };
    for (position, argument) in arguments.split(',').enumerate() {
        let Some((key, text)) = argument.split_once('=') else {
            let preset = presets.iter().find(|(name, _)| *name == argument);
            match preset {
                Some((_, preset_values)) if position == 0 => values = *preset_values,
                _ => return Err(unknown_argument(spec, argument, parameters, presets)),
            }
            continue;
        };
        let Some(index) = parameters.iter().position(|p| p.key == key) else {
            return Err(unknown_argument(spec, key, parameters, presets));
        };
        if std::mem::replace(&mut given[index], true) {
            return Err(error(spec, key, "the parameter once", "it twice"));
        }
        values[index] = number(spec, &parameters[index], text)?;
    }
    Ok(values)
}

/// The number `text` for one parameter, checked against its range.
pub(super) fn number(spec: &str, parameter: &Parameter, text: &str) -> Result<f64, SampleError> {
    let Parameter { key, min, max } = parameter;
    match text.parse::<f64>() {
        Ok(value) if (*min..=*max).contains(&value) => Ok(value),
        _ => Err(error(
            spec,
            key,
            &format!("a number from {min} to {max}"),
            &format!("'{text}'"),
        )),
    }
}

/// An error about one `field` of `spec`.
pub(super) fn error(spec: &str, field: &str, expected: &str, found: &str) -> SampleError {
    SampleError::Spec {
        spec: spec.to_owned(),
        field: field.to_owned(),
        expected: expected.to_owned(),
        found: found.to_owned(),
    }
}

fn unknown_argument<const N: usize>(
    spec: &str,
    found: &str,
    parameters: &[Parameter; N],
    presets: &[Preset<N>],
) -> SampleError {
    let names: Vec<&str> = presets.iter().map(|preset| preset.0).collect();
    let keys: Vec<String> = parameters.iter().map(|p| format!("{}=", p.key)).collect();
    let expected = format!("a leading preset ({}) or {}", names.join(", "), keys.join(", "));
    error(spec, "arguments", &expected, &format!("'{found}'"))
}
