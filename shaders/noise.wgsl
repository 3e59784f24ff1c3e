// Calibrated noise over virtual pixels (Fischer 2006, noise overlay).
//
// The pattern is a hash of (seed, frame, lattice point, channel) through a table of the normal
// distribution in whole numbers, filtered to the camera's neighbour correlation, mixed to its
// channel correlation, and scaled to the variance that the pixel lacks.
// @import shared/hash
struct Noise {
    // xyz: where in the endless hash this frame's pattern lies
    key: vec4<u32>,
    // x, y: side weight of the three-tap filters; z: magnification; w: scale
    filter_shape: vec4<f32>,
    // Correlation of lattice neighbours right and below.
    lattice: vec4<f32>,
    // Lower triangle of the channels' Cholesky factor: (l21, l22, l31, l32), l33
    mix_a: vec4<f32>,
    mix_b: vec4<f32>,
}
@group(0) @binding(4) var<storage, read> noise: Noise;
// 4096 quantiles of the normal distribution, 64 × 64, in 1/4096 σ.
@group(0) @binding(5) var normal_table: texture_2d<i32>;

fn normal_at(lattice: vec2<i32>) -> vec3<f32> {
    let h = pcg3d(vec3<u32>(bitcast<vec2<u32>>(lattice), 0u) + noise.key.xyz) >> vec3<u32>(20u);
    return vec3<f32>(
        f32(textureLoad(normal_table, vec2<u32>(h.x & 63u, h.x >> 6u), 0).x),
        f32(textureLoad(normal_table, vec2<u32>(h.y & 63u, h.y >> 6u), 0).x),
        f32(textureLoad(normal_table, vec2<u32>(h.z & 63u, h.z >> 6u), 0).x),
    ) / 4096.0;
}

// The lattice's noise with its neighbour correlation, variance 1: taps (a, 1, a) each way.
fn filtered_at(lattice: vec2<i32>) -> vec3<f32> {
    let a = noise.filter_shape.xy;
    if a.x == 0.0 && a.y == 0.0 {
        return normal_at(lattice);
    }
    var sum = vec3<f32>(0.0);
    for (var j = -1; j <= 1; j++) {
        let wy = select(a.y, 1.0, j == 0);
        for (var i = -1; i <= 1; i++) {
            sum += wy * select(a.x, 1.0, i == 0) * normal_at(lattice + vec2<i32>(i, j));
        }
    }
    return sum * inverseSqrt((1.0 + 2.0 * a.x * a.x) * (1.0 + 2.0 * a.y * a.y));
}

// The pattern at a pixel of the picture, variance 1 everywhere.
fn pattern_at(pixel: vec2<i32>) -> vec3<f32> {
    if noise.filter_shape.z <= 1.0 {
        return filtered_at(pixel);
    }
    // Patches larger than a pixel: interpolated, and the variance that interpolation takes
    // away given back: Σ wᵢ wⱼ ρᵢⱼ, which separates into the two axes.
    let x = (vec2<f32>(pixel) + 0.5) / noise.filter_shape.z;
    let base = floor(x);
    let f = x - base;
    let i = vec2<i32>(base);
    let top = mix(filtered_at(i), filtered_at(i + vec2<i32>(1, 0)), f.x);
    let bottom = mix(filtered_at(i + vec2<i32>(0, 1)), filtered_at(i + vec2<i32>(1, 1)), f.x);
    let variance = f * f + (1.0 - f) * (1.0 - f) + 2.0 * f * (1.0 - f) * noise.lattice.xy;
    return mix(top, bottom, f.y) * inverseSqrt(variance.x * variance.y);
}

fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let n = pattern_at(p + composite.origin.xy);
    let mixed = vec3<f32>(
        n.x,
        noise.mix_a.x * n.x + noise.mix_a.y * n.y,
        noise.mix_a.z * n.x + noise.mix_a.w * n.y + noise.mix_b.x * n.z,
    );
    let wanted = sigma_at(pixel.code) * noise.filter_shape.w;
    let missing = max(wanted * wanted - pixel.camera_variance, vec3<f32>(0.0));
    return Mixed(pixel.code + sqrt(missing) * mixed / 255.0, pixel.camera_variance + missing);
}
