//! Pictures of known noise for the tests.

use crate::pixels::Pixels;
use crate::simulate::random::Random;

/// Standard normal numbers.
pub struct Normals {
    random: Random,
    second: Option<f64>,
}

impl Normals {
    pub fn new(seed: u64) -> Self {
        Self { random: Random::new([seed, 0, 0, 0]), second: None }
    }

    pub fn next(&mut self) -> f64 {
        if let Some(second) = self.second.take() {
            return second;
        }
        let [first, second] = self.random.normals();
        self.second = Some(second);
        first
    }
}

/// A square grey picture of rounded values.
pub fn grey_picture(side: usize, values: &[f64]) -> Pixels {
    let codes = values.iter().flat_map(|v| [v.round() as u8; 3]).collect();
    Pixels::from_u8(side as u32, side as u32, codes).unwrap()
}
