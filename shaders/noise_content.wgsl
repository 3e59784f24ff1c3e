// Content of the noise by example: latent values, and the energies of gradients and fine detail
// (src/example_noise/{latent,content}.rs).
// @import shared/fullscreen
// @import shared/example_noise

@group(0) @binding(0) var<uniform> example: Example;
// R'G'B' without noise on the scale of 8-bit codes, not clipped; alpha is the changed share.
@group(0) @binding(1) var uncoded: texture_2d<f32>;
// Energies of pixels; of blocks, the gradients' in x.
@group(0) @binding(2) var energies: texture_2d<f32>;
// Rectangles of the target: x0, y0, x1, y1.
@group(0) @binding(3) var<storage, read> parts: array<vec4<i32>>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, vec2<f32>(example.region));
}

// The latent value of each channel. Values above the largest code are latent already.
fn latent_of(rgb: vec3<f32>) -> vec3<f32> {
    let shown = clamp(rgb, vec3<f32>(0.0), vec3<f32>(255.0));
    var low = example.latent[0];
    var latent = vec3<f32>(low.xyz);
    for (var i = 1; i < 20; i++) {
        let high = example.latent[i];
        let share = clamp((shown - low.w) / (high.w - low.w), vec3<f32>(0.0), vec3<f32>(1.0));
        latent = select(latent, low.xyz + share * (high.xyz - low.xyz), shown >= vec3<f32>(low.w));
        low = high;
    }
    return select(latent, max(rgb, latent), rgb > vec3<f32>(255.0));
}

// The border of the coded picture repeats.
fn brightness_at(at: vec2<i32>) -> f32 {
    let inside = clamp(at, example.extent.xy, example.extent.zw - 1);
    return brightness_of(textureLoad(uncoded, clamp(inside, vec2<i32>(0), example.region - 1), 0).rgb);
}

struct Content {
    @location(0) latent: vec4<f32>,
    // Squared Sobel gradient and energy of fine detail, codes².
    @location(1) energies: vec2<f32>,
}

@fragment
fn content(@builtin(position) at: vec4<f32>) -> Content {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(uncoded, p, 0);
    var upper: vec3<f32>;
    var middle: vec3<f32>;
    var lower: vec3<f32>;
    for (var i = 0; i < 3; i++) {
        upper[i] = brightness_at(p + vec2<i32>(i - 1, -1));
        middle[i] = brightness_at(p + vec2<i32>(i - 1, 0));
        lower[i] = brightness_at(p + vec2<i32>(i - 1, 1));
    }
    let along = (upper.z - upper.x) + 2.0 * (middle.z - middle.x) + (lower.z - lower.x);
    let down = (lower.x - upper.x) + 2.0 * (lower.y - upper.y) + (lower.z - upper.z);
    // No gradient at the border of the coded picture.
    let is_inside = all(p > example.extent.xy) && all(p < example.extent.zw - 1);
    let gradient = select(0.0, (along * along + down * down) / 64.0, is_inside);
    let s = vec3<f32>(0.25, 0.5, 0.25);
    let detail = middle.y - dot(s, vec3<f32>(dot(s, upper), dot(s, middle), dot(s, lower)));
    let latent = mix(own.rgb, latent_of(own.rgb), own.a);
    return Content(vec4<f32>(latent, own.a), vec2<f32>(gradient, detail * detail));
}

// Mean gradients over blocks of 2 × 2 px.
@fragment
fn blocks(@builtin(position) at: vec4<f32>) -> @location(0) f32 {
    let p = 2 * vec2<i32>(at.xy);
    let sum = textureLoad(energies, p, 0).x + textureLoad(energies, p + vec2<i32>(1, 0), 0).x
        + textureLoad(energies, p + vec2<i32>(0, 1), 0).x + textureLoad(energies, p + 1, 0).x;
    return 0.25 * sum;
}

// A block, with the border of the coded picture repeated.
fn block_at(at: vec2<i32>) -> f32 {
    let inside = clamp(at, example.extent.xy / 2, example.extent.zw / 2 - 1);
    return textureLoad(energies, clamp(inside, vec2<i32>(0), example.region / 2 - 1), 0).x;
}

// (1 2 1)/4 along both axes, with taps some blocks apart.
fn smoothed_at(p: vec2<i32>, apart: i32) -> f32 {
    var sum = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let weight = select(0.25, 0.5, i == 0) * select(0.25, 0.5, j == 0);
            sum += weight * block_at(p + apart * vec2<i32>(i, j));
        }
    }
    return sum;
}

@fragment
fn smoothed(@builtin(position) at: vec4<f32>) -> @location(0) f32 {
    return smoothed_at(vec2<i32>(at.xy), 1);
}

// Energies of coarse and of fine gradients.
@fragment
fn activity(@builtin(position) at: vec4<f32>) -> @location(0) vec2<f32> {
    let p = vec2<i32>(at.xy);
    return vec2<f32>(smoothed_at(p, 2), block_at(p));
}
