// Code value ↔ linear light, relative to diffuse white (src/camera/response.rs). Curve 0: sRGB, 1:
// linear, 2: power law, 3: the samples of any other curve.
// @import shared/srgb

// Light at equidistant codes from 0 to 1, for curve 3.
@group(0) @binding(40) var<storage, read> response_samples: array<f32>;

// Light at a code; beyond 0 and 1 the curve goes on straight.
fn sampled_light(code: f32) -> f32 {
    let last = arrayLength(&response_samples) - 1u;
    let at = code * f32(last);
    let i = u32(clamp(at, 0.0, f32(last - 1u)));
    return mix(response_samples[i], response_samples[i + 1u], at - f32(i));
}

// The interval of the samples that light is in, by bisection.
fn interval_of_light(light: f32) -> u32 {
    var low = 0u;
    var high = arrayLength(&response_samples) - 1u;
    while high - low > 1u {
        let middle = (low + high) / 2u;
        if response_samples[middle] <= light {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

fn sampled_code(light: f32) -> f32 {
    let i = interval_of_light(light);
    let from_light = response_samples[i];
    let step = max(response_samples[i + 1u] - from_light, 1e-9);
    return (f32(i) + (light - from_light) / step) / f32(arrayLength(&response_samples) - 1u);
}

// d code / d light.
fn sampled_slope(light: f32) -> f32 {
    let i = interval_of_light(light);
    let step = max(response_samples[i + 1u] - response_samples[i], 1e-9);
    return 1.0 / (step * f32(arrayLength(&response_samples) - 1u));
}

fn decode(code: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    if curve > 2.5 {
        return vec3<f32>(sampled_light(code.r), sampled_light(code.g), sampled_light(code.b));
    }
    if curve > 1.5 {
        return pow(code, vec3<f32>(gamma));
    }
    if curve > 0.5 {
        return code;
    }
    return srgb_light(code);
}

fn encode(light: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    if curve > 2.5 {
        return vec3<f32>(sampled_code(light.r), sampled_code(light.g), sampled_code(light.b));
    }
    let l = max(light, vec3<f32>(0.0));
    if curve > 1.5 {
        return pow(l, vec3<f32>(1.0 / gamma));
    }
    if curve > 0.5 {
        return l;
    }
    return select(1.055 * pow(l, vec3<f32>(1.0 / 2.4)) - 0.055, l * 12.92, l <= vec3<f32>(0.0031308));
}

// Light of the smallest and the largest code.
fn min_light(curve: f32) -> f32 {
    if curve > 2.5 {
        return response_samples[0];
    }
    return 0.0;
}

fn max_light(curve: f32) -> f32 {
    if curve > 2.5 {
        return response_samples[arrayLength(&response_samples) - 1u];
    }
    return 1.0;
}

// d code / d light at a code value and its light.
fn slope_at(code: vec3<f32>, light: vec3<f32>, curve: f32, gamma: f32) -> vec3<f32> {
    if curve > 2.5 {
        return vec3<f32>(sampled_slope(light.r), sampled_slope(light.g), sampled_slope(light.b));
    }
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
