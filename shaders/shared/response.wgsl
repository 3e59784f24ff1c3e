// Code value ↔ linear light, both 0 to 1 (full scale). Curve 0: sRGB (IEC 61966-2-1), 1: linear, 2:
// power law.

fn decode(code: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    if curve > 1.5 {
        return pow(code, vec3<f32>(gamma));
    }
    if curve > 0.5 {
        return code;
    }
    return select(pow((code + 0.055) / 1.055, vec3<f32>(2.4)), code / 12.92, code <= vec3<f32>(0.04045));
}

fn encode(light: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    let l = max(light, vec3<f32>(0.0));
    if curve > 1.5 {
        return pow(l, vec3<f32>(1.0 / gamma));
    }
    if curve > 0.5 {
        return l;
    }
    return select(1.055 * pow(l, vec3<f32>(1.0 / 2.4)) - 0.055, l * 12.92, l <= vec3<f32>(0.0031308));
}

// d code / d light at a code value and its light.
fn slope_at(code: vec3<f32>, light: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    if curve > 1.5 {
        // Infinite at 0: taken at the first of 255 codes.
        let first = vec3<f32>(1.0 / 255.0);
        return max(code, first) / (gamma * max(light, pow(first, vec3<f32>(gamma))));
    }
    if curve > 0.5 {
        return vec3<f32>(1.0);
    }
    let knee = vec3<f32>(0.0031308);
    return select((code + 0.055) / (2.4 * max(light, knee)), vec3<f32>(12.92), code <= vec3<f32>(0.04045));
}
