//! The camera's response: code value ↔ linear light, both as fractions of full scale.

crate::choices! {
    /// The curve between linear light and code values.
    pub enum Curve {
        /// IEC 61966-2-1.
        Srgb = "srgb",
        /// Code values are proportional to light.
        Linear = "linear",
        /// A power law with `gamma`.
        Gamma = "gamma",
    }
}

crate::params! {
    /// Conversion of linear light to code values.
    pub struct Response in "camera.response" at Depth {
        "the curve" curve: Curve = Curve::Srgb;
        "exponent of the curve gamma: code = light^(1/gamma)" gamma: f64 = 2.2, "1", 0.2..=5.0, by_ratio => curve is "gamma";
    }
}

impl Response {
    /// Code value (0..1) to linear light (0..1).
    pub fn decode(&self, code: f64) -> f64 {
        match self.curve {
            Curve::Srgb if code <= 0.04045 => code / 12.92,
            Curve::Srgb => ((code + 0.055) / 1.055).powf(2.4),
            Curve::Linear => code,
            Curve::Gamma => code.max(0.0).powf(self.gamma),
        }
    }

    /// The light of each code from 0 to `max_code`.
    pub fn table(&self, max_code: u32) -> Vec<f64> {
        (0..=max_code).map(|code| self.decode(f64::from(code) / f64::from(max_code))).collect()
    }

    /// Linear light to code value; both 0..1, brighter light clips at 1.
    pub fn encode(&self, light: f64) -> f64 {
        let light = light.clamp(0.0, 1.0);
        match self.curve {
            Curve::Srgb if light <= 0.003_130_8 => light * 12.92,
            Curve::Srgb => 1.055 * light.powf(1.0 / 2.4) - 0.055,
            Curve::Linear => light,
            Curve::Gamma => light.powf(1.0 / self.gamma),
        }
    }

    /// Slope d code / d light at a code value (0..1).
    pub fn slope_at_code(&self, code: f64) -> f64 {
        match self.curve {
            Curve::Srgb if code <= 0.04045 => 12.92,
            // light = ((c + 0.055)/1.055)^2.4, so d code/d light = 1.055/2.4 · ((c +
            // 0.055)/1.055)^-1.4.
            Curve::Srgb => 1.055 / 2.4 * ((code + 0.055) / 1.055).powf(-1.4),
            Curve::Linear => 1.0,
            // light = c^γ, so d code/d light = c^(1-γ)/γ; kept finite at black.
            Curve::Gamma => code.max(1.0 / 255.0).powf(1.0 - self.gamma) / self.gamma,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_matches_known_values_and_round_trips() {
        let srgb = Response::default();
        // 18 % grey is code 0.4614 (117.6 of 255).
        assert!((srgb.encode(0.18) - 0.461_356).abs() < 1e-5);
        for curve in [Curve::Srgb, Curve::Linear, Curve::Gamma] {
            let r = Response { curve, gamma: 2.2 };
            for i in 0..=255 {
                let code = f64::from(i) / 255.0;
                assert!((r.encode(r.decode(code)) - code).abs() < 1e-6);
                if (2..254).contains(&i) {
                    let h = 1e-6;
                    let numeric = 2.0 * h / (r.decode(code + h) - r.decode(code - h));
                    assert!((r.slope_at_code(code) / numeric - 1.0).abs() < 1e-3, "{curve:?} {i}");
                }
            }
        }
    }
}
