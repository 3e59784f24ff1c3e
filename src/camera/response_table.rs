//! A response given by points, of a measurement or a lookup table.

use std::fmt::Write;
use std::sync::Arc;

use crate::params::{Field, Kind, Value};
use crate::text::number;

/// Largest number of points.
const MAX_POINTS: usize = 65_536;
/// Largest light of a point, relative to diffuse white: the range of 16-bit floats.
const MAX_LIGHT: f64 = 60_000.0;

/// Points (code, light) of a response, linear between them. Codes are fractions of full scale from
/// 0 to 1; light is relative to diffuse white. Both ascend.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseTable(Arc<[[f64; 2]]>);

/// Codes proportional to light.
impl Default for ResponseTable {
    fn default() -> Self {
        Self([[0.0, 0.0], [1.0, 1.0]].into())
    }
}

impl ResponseTable {
    /// A table of points. The error describes the first flaw.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, String> {
        let [Some(first), Some(last)] = [points.first(), points.last()] else {
            return Err("holds no points".to_owned());
        };
        if first[0] != 0.0 || last[0] != 1.0 || points.len() > MAX_POINTS {
            return Err(format!(
                "has {} points of the codes {} to {}; expected 2 to {MAX_POINTS} from 0 to 1",
                points.len(),
                number(first[0]),
                number(last[0])
            ));
        }
        let ascends = |pair: &[[f64; 2]]| pair[0][0] < pair[1][0] && pair[0][1] < pair[1][1];
        if let Some(at) = points.windows(2).position(|pair| !ascends(pair)) {
            let [code, light] = points[at + 1].map(number);
            return Err(format!("does not ascend at code {code}, light {light}: a response must be invertible"));
        }
        if !points.iter().flatten().all(|value| value.abs() <= MAX_LIGHT) {
            return Err(format!("holds a number beyond ±{MAX_LIGHT}, the range of 16-bit floats"));
        }
        Ok(Self(points.into()))
    }

    /// Parses pairs of code and light: `0 0, 0.5 0.2, 1 1`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let pair = |text: &str| {
            let mut numbers = text.split_whitespace().map(str::parse::<f64>);
            match (numbers.next(), numbers.next(), numbers.next()) {
                (Some(Ok(code)), Some(Ok(light)), None) => Ok([code, light]),
                _ => Err(format!("{} is not a pair of code and light", crate::text::quoted(text.trim()))),
            }
        };
        Self::new(
            text.split([',', ';', '\n']).filter(|text| !text.trim().is_empty()).map(pair).collect::<Result<_, _>>()?,
        )
    }

    /// Light of a code.
    pub fn light(&self, code: f64) -> f64 {
        let after = self.0.partition_point(|point| point[0] <= code).clamp(1, self.0.len() - 1);
        let ([code_a, light_a], [code_b, light_b]) = (self.0[after - 1], self.0[after]);
        let code = code.clamp(0.0, 1.0);
        light_a + (light_b - light_a) * (code - code_a) / (code_b - code_a)
    }
}

impl Field for ResponseTable {
    fn kind(_: Option<(f64, f64)>) -> Kind {
        Kind::Points
    }

    fn to_value(&self) -> Value {
        let mut text = String::new();
        for [code, light] in self.0.iter() {
            let separator = if text.is_empty() { "" } else { ", " };
            // Writing into a string cannot fail.
            let _ = write!(text, "{separator}{} {}", number(*code), number(*light));
        }
        Value::Text(text)
    }

    fn from_value(value: &Value, _: &Kind) -> Option<Self> {
        match value {
            Value::Text(text) => Self::parse(text).ok(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_linear_between_its_points_and_round_trips_as_text() {
        let table = ResponseTable::parse("0 -0.01, 0.5 0.2; 1 3").unwrap();
        for (code, light) in
            [(-1.0, -0.01), (0.0, -0.01), (0.25, 0.095), (0.5, 0.2), (0.75, 1.6), (1.0, 3.0), (2.0, 3.0)]
        {
            assert!((table.light(code) - light).abs() < 1e-12, "{code}");
        }
        assert_eq!(ResponseTable::from_value(&table.to_value(), &Kind::Points), Some(table));
    }

    #[test]
    fn useless_tables_are_refused() {
        for (text, problem) in [
            ("", "holds no points"),
            ("0 0, 0.9 1", "has 2 points of the codes 0 to 0.9"),
            ("0 0, 0.5 0.5, 0.4 0.6, 1 1", "does not ascend at code 0.4, light 0.6"),
            ("0 0, 0.5 0.5, 0.6 0.5, 1 1", "does not ascend"),
            ("0 0, 1 inf", "beyond ±60000"),
            ("0 -1e308, 1 1e308", "beyond ±60000"),
            ("0 0, 1", "1 is not a pair"),
        ] {
            let error = ResponseTable::parse(text).unwrap_err();
            assert!(error.contains(problem), "{text}: {error}");
        }
    }
}
