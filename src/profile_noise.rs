//! The table `[camera.noise]` of a profile, read and written.
//!
//! `code` holds the bins' middles, ascending, and `sigma_r`, `sigma_g`, `sigma_b` one standard
//! deviation for each, all in 8-bit code values; `channel_correlation` is that of R-G, R-B and
//! G-B, `neighbour_correlation` that with the pixel to the right and with the one below.

use crate::camera::{NoiseBin, NoiseProfile};

/// What is wrong with a noise table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("camera.noise.{key}: found {found}; accepted is {accepted}")]
pub struct NoiseTableError {
    pub key: String,
    pub found: String,
    pub accepted: String,
}

const KEYS: [&str; 6] = ["code", "sigma_r", "sigma_g", "sigma_b", "channel_correlation", "neighbour_correlation"];

fn error(key: &str, found: impl ToString, accepted: impl ToString) -> NoiseTableError {
    NoiseTableError { key: key.to_owned(), found: found.to_string(), accepted: accepted.to_string() }
}

/// The numbers at a key, each in the closed range; `None` where the key is missing.
fn numbers(table: &toml::Table, key: &str, low: f64, high: f64) -> Result<Option<Vec<f64>>, NoiseTableError> {
    let accepted = format!("a list of numbers from {low} to {high}");
    let Some(value) = table.get(key) else { return Ok(None) };
    let list = value.as_array().ok_or_else(|| error(key, value, &accepted))?;
    list.iter()
        .map(|entry| {
            let number = entry.as_float().or_else(|| entry.as_integer().map(|i| i as f64));
            number.filter(|n| *n >= low && *n <= high).ok_or_else(|| error(key, entry, &accepted))
        })
        .collect::<Result<_, _>>()
        .map(Some)
}

fn fixed<const N: usize>(table: &toml::Table, key: &str, low: f64) -> Result<[f64; N], NoiseTableError> {
    let Some(list) = numbers(table, key, low, 1.0)? else { return Ok([0.0; N]) };
    let found = format!("{} numbers", list.len());
    list.try_into().map_err(|_| error(key, found, format!("{N} numbers")))
}

/// Reads the table. Correlations that are missing are 0.
pub fn noise_profile_from_toml(table: &toml::Table) -> Result<NoiseProfile, NoiseTableError> {
    if let Some(unknown) = table.keys().find(|k| !KEYS.contains(&k.as_str())) {
        return Err(error(unknown, "an unknown key", KEYS.join(", ")));
    }
    let codes = numbers(table, "code", 0.0, 255.0)?.unwrap_or_default();
    if codes.is_empty() || codes.windows(2).any(|w| w[0] >= w[1]) {
        return Err(error("code", format!("{codes:?}"), "at least one code value, ascending"));
    }
    let bins = |key: &str| {
        let sigmas = numbers(table, key, 0.0, 255.0)?.unwrap_or_default();
        if sigmas.len() != codes.len() {
            let accepted = format!("{} of them, one for each code", codes.len());
            return Err(error(key, format!("{} values", sigmas.len()), accepted));
        }
        Ok(codes.iter().zip(sigmas).map(|(&code, sigma)| NoiseBin { code, sigma }).collect())
    };
    Ok(NoiseProfile {
        bins: [bins("sigma_r")?, bins("sigma_g")?, bins("sigma_b")?],
        channel_correlation: fixed(table, "channel_correlation", -1.0)?,
        neighbour_correlation: fixed(table, "neighbour_correlation", -1.0)?,
    })
}

/// Writes the table, rounded to thousandths. All channels must have the first one's codes.
pub fn noise_table_toml(noise: &NoiseProfile) -> toml::Table {
    let list = |values: Vec<f64>| {
        toml::Value::Array(values.iter().map(|v| toml::Value::Float((v * 1000.0).round() / 1000.0)).collect())
    };
    let mut table = toml::Table::new();
    table.insert("code".to_owned(), list(noise.bins[0].iter().map(|b| b.code).collect()));
    for (bins, key) in noise.bins.iter().zip(["sigma_r", "sigma_g", "sigma_b"]) {
        table.insert(key.to_owned(), list(bins.iter().map(|b| b.sigma).collect()));
    }
    table.insert("channel_correlation".to_owned(), list(noise.channel_correlation.to_vec()));
    table.insert("neighbour_correlation".to_owned(), list(noise.neighbour_correlation.to_vec()));
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<NoiseProfile, NoiseTableError> {
        noise_profile_from_toml(&text.parse().unwrap())
    }

    #[test]
    fn what_is_written_is_read_again() {
        let bins = |s: f64| vec![NoiseBin { code: 16.0, sigma: s }, NoiseBin { code: 200.0, sigma: 2.0 * s }];
        let noise = NoiseProfile {
            bins: [bins(1.0), bins(1.5), bins(0.125)],
            channel_correlation: [0.5, -0.25, 0.0],
            neighbour_correlation: [0.4, 0.3],
        };
        assert_eq!(noise_profile_from_toml(&noise_table_toml(&noise)), Ok(noise));
    }

    #[test]
    fn errors_name_the_key() {
        let rest = "sigma_r = [1]\nsigma_g = [1]\nsigma_b = [1]\n";
        for (text, key) in [
            (rest.to_owned(), "code"),
            (format!("code = [9, 3]\n{rest}"), "code"),
            (format!("code = [300]\n{rest}"), "code"),
            ("code = [3]\nsigma_r = [-1]\n".to_owned(), "sigma_r"),
            ("code = [3]\nsigma_r = [1]\nsigma_g = [1, 2]\nsigma_b = [1]".to_owned(), "sigma_g"),
            (format!("code = [3]\n{rest}channel_correlation = [0.1]"), "channel_correlation"),
            (format!("code = [3]\n{rest}sigma_x = [1]"), "sigma_x"),
        ] {
            assert_eq!(read(&text).unwrap_err().key, key, "{text}");
        }
    }
}
