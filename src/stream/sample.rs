//! An OpenTrackIO sample: a map, kept as received. Known values are read by name. Unknown ones stay
//! in it, so that a rewritten sample is complete.

use std::borrow::Cow;

use ciborium::value::{Integer, Value};
use glam::DVec3;

use super::error::SampleError;
use super::packet::Encoding;

/// Deepest accepted nesting of CBOR. The official samples have 5 levels. (`serde_json` stops at
/// 128.)
const MAX_CBOR_DEPTH: usize = 64;

/// Keys are in the order of arrival.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample(Value);

impl Default for Sample {
    fn default() -> Self {
        Self(Value::Map(Vec::new()))
    }
}

impl Sample {
    pub fn decode(encoding: Encoding, mut bytes: &[u8]) -> Result<Self, SampleError> {
        let value: Value = match encoding {
            Encoding::Json => serde_json::from_slice(bytes).map_err(|e| SampleError::Json(e.to_string()))?,
            Encoding::Cbor => {
                let value = ciborium::de::from_reader_with_recursion_limit(&mut bytes, MAX_CBOR_DEPTH);
                let value = value.map_err(|e| SampleError::Cbor(e.to_string()))?;
                if !bytes.is_empty() {
                    return Err(SampleError::Rest(bytes.len()));
                }
                value
            }
        };
        if !value.is_map() {
            return Err(SampleError::NoMap);
        }
        let sample = Self(value);
        match sample.text(&["protocol", "name"]) {
            Some(name) if name != "OpenTrackIO" => Err(SampleError::OtherProtocol(name.to_owned())),
            _ => Ok(sample),
        }
    }

    /// Encodes the sample; [`Sample::decode`] restores it exactly. Values that only CBOR can
    /// represent (bytes, tags, keys other than text, numbers that are not finite) are only
    /// preserved in CBOR.
    pub fn encode(&self, encoding: Encoding) -> Result<Vec<u8>, SampleError> {
        match encoding {
            Encoding::Json => serde_json::to_vec(&self.0).map_err(|e| SampleError::Json(e.to_string())),
            Encoding::Cbor => {
                let mut bytes = Vec::new();
                ciborium::into_writer(&self.0, &mut bytes).map_err(|e| SampleError::Cbor(e.to_string()))?;
                Ok(bytes)
            }
        }
    }

    pub fn get(&self, path: &[&str]) -> Option<&Value> {
        path.iter().try_fold(&self.0, |value, key| member(value, key))
    }

    pub fn text(&self, path: &[&str]) -> Option<&str> {
        self.get(path)?.as_text()
    }

    /// A finite number.
    pub fn number(&self, path: &[&str]) -> Option<f64> {
        number(self.get(path)?)
    }

    pub fn unsigned(&self, path: &[&str]) -> Option<u64> {
        unsigned(self.get(path)?)
    }

    /// A rational number in the schema's form, `num` over `denom`; above 0.
    pub fn ratio(&self, path: &[&str]) -> Option<f64> {
        let value = self.get(path)?;
        let ratio = number(member(value, "num")?)? / number(member(value, "denom")?)?;
        (ratio.is_finite() && ratio > 0.0).then_some(ratio)
    }

    pub fn numbers(&self, path: &[&str]) -> Option<Vec<f64>> {
        numbers(self.get(path)?)
    }

    /// The protocol's version, such as `1.0.1`; early senders sent a text.
    pub fn version(&self) -> Option<Cow<'_, str>> {
        let value = self.get(&["protocol", "version"])?;
        let of_list = || Some(numbers(value)?.iter().map(f64::to_string).collect::<Vec<_>>().join(".").into());
        value.as_text().map(Cow::Borrowed).or_else(of_list)
    }

    /// Sets a value at a path and creates the maps on the way. Other values on the way are
    /// replaced.
    pub fn set(&mut self, path: &[&str], value: impl Into<Value>) {
        let mut at = &mut self.0;
        for key in path {
            if !at.is_map() {
                *at = Value::Map(Vec::new());
            }
            let Value::Map(map) = at else { return };
            let index = map.iter().position(|(name, _)| name.as_text() == Some(key));
            let i = index.unwrap_or_else(|| {
                map.push((Value::from(*key), Value::Null));
                map.len() - 1
            });
            at = &mut map[i].1;
        }
        *at = value.into();
    }
}

/// The value of a key; the last one if the key is repeated.
pub fn member<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    value.as_map()?.iter().rev().find(|(name, _)| name.as_text() == Some(key)).map(|(_, value)| value)
}

/// A finite number.
pub fn number(value: &Value) -> Option<f64> {
    let whole = |i: Integer| i128::from(i) as f64;
    value.as_float().or_else(|| value.as_integer().map(whole)).filter(|number| number.is_finite())
}

fn unsigned(value: &Value) -> Option<u64> {
    value.as_integer().and_then(|i| i.try_into().ok())
}

pub fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(number).collect()
}

/// A map of `x`, `y`, `z`, or of other names. Missing values are 0, as in the schema. `None` if one
/// is not a number.
pub fn triple(value: &Value, names: [&str; 3]) -> Option<DVec3> {
    value.as_map()?;
    let [x, y, z] = names.map(|name| member(value, name).map_or(Some(0.0), number));
    Some(DVec3::new(x?, y?, z?))
}

/// A map from names to values.
pub fn map<const N: usize>(members: [(&str, Value); N]) -> Value {
    Value::Map(members.into_iter().map(|(name, value)| (name.into(), value)).collect())
}

/// A rate as a rational number of the schema, to a millionth.
pub fn rational(rate: f64) -> Value {
    // Broadcast rates are exact: 24000/1001 and the like.
    let ntsc = (rate * 1.001).round();
    let is_ntsc = (ntsc / 1.001 - rate).abs() < 1e-6 * rate && (rate - rate.round()).abs() > 1e-6;
    let (num, denom) = if is_ntsc { (1000.0 * ntsc, 1001) } else { ((1e6 * rate).round(), 1_000_000) };
    // The schema allows 31 bits.
    let (num, denom) = if num > 2e9 { (rate.round().min(2e9), 1) } else { (num, denom) };
    map([("num", (num.max(1.0) as u64).into()), ("denom", denom.into())])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(text: &str) -> Result<Sample, SampleError> {
        Sample::decode(Encoding::Json, text.as_bytes())
    }

    #[test]
    fn unknown_values_are_kept_in_order() {
        let text = r#"{"zeta":[1,-2,3.5,null,true,"x"],"alpha":{"b":{"c":18446744073709551615}},"static":{}}"#;
        let sample = json(text).unwrap();
        assert_eq!(String::from_utf8(sample.encode(Encoding::Json).unwrap()).unwrap(), text);
        let again = Sample::decode(Encoding::Cbor, &sample.encode(Encoding::Cbor).unwrap()).unwrap();
        assert_eq!(again, sample);
        // CBOR can represent more than JSON.
        let rich = [0xA2, 0x01, 0x42, 0xAB, 0xCD, 0x61, b't', 0xC1, 0xF9, 0x7C, 0x00];
        let sample = Sample::decode(Encoding::Cbor, &rich).unwrap();
        assert_eq!(sample.encode(Encoding::Cbor).unwrap(), rich);
    }

    #[test]
    fn values_are_read_and_set_by_path() {
        let mut sample = json(r#"{"a":{"b":1,"r":{"num":30000,"denom":1001}},"n":[1,2.5]}"#).unwrap();
        assert_eq!((sample.number(&["a", "b"]), sample.unsigned(&["a", "b"])), (Some(1.0), Some(1)));
        assert_eq!(sample.ratio(&["a", "r"]), Some(30000.0 / 1001.0));
        assert_eq!(sample.numbers(&["n"]), Some(vec![1.0, 2.5]));
        assert_eq!((sample.number(&["a"]), sample.number(&["a", "b", "c"]), sample.text(&["n"])), (None, None, None));
        sample.set(&["a", "b", "c"], "deep");
        sample.set(&["new", "x"], 0.5);
        assert_eq!((sample.text(&["a", "b", "c"]), sample.number(&["new", "x"])), (Some("deep"), Some(0.5)));
    }

    #[test]
    fn malformed_samples_are_refused() {
        for text in ["", "[]", "1", "{", "{\"a\":1}x", "\u{feff}{}", &"[".repeat(100_000)] {
            assert!(json(text).is_err(), "{}", &text[..text.len().min(9)]);
        }
        let other = json(r#"{"protocol":{"name":"Other"}}"#).unwrap_err();
        assert_eq!(other, SampleError::OtherProtocol("Other".into()));
        // Endless nesting, an endless array, text with a huge length, bytes after the end.
        let deep = vec![0x81; 100_000];
        let cases: [&[u8]; 5] = [
            &deep,
            &[0x9B, 255, 255, 255, 255, 255, 255, 255, 255],
            &[0x7B, 0, 0, 255, 255, 255, 255, 255, 255, b'a'],
            &[0xA0, 0xA0],
            b"",
        ];
        for bytes in cases {
            assert!(Sample::decode(Encoding::Cbor, bytes).is_err(), "{:?}", &bytes[..bytes.len().min(9)]);
        }
    }
}
