// Wang's depth of field (src/effects/depth_of_field/diffusion.rs): each pixel's light is spread by
// the operator of its blur factor, from the largest to the smallest, and pixels nearly in focus are
// mixed with the original.
// @import shared/fullscreen
// @import shared/half
// @import shared/layer
// @import shared/lens

// How light from different depths is mixed: true as in the paper, false keeps light.
override printed: bool = false;

struct Wang {
    mix_ratio: f32,
    blend_below: f32,
    margin: i32,       // texels of an operator beyond its radius
    half_side: i32,    // of every operator's square
}
@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var geometry: texture_2d<u32>;
@group(0) @binding(1) var factors: texture_2d<f32>;
@group(0) @binding(2) var color: texture_2d<f32>;
// Stacked vertically.
@group(0) @binding(3) var operators: texture_2d<f32>;
@group(0) @binding(4) var around_tiles: texture_2d<f32>;
@group(0) @binding(5) var<storage, read> wang: Wang;

const MAX_STEPS: i32 = 32;

// Step of the blur factor, the factor, the orientation of the opening's image, and 1 (0 where
// nothing was drawn).
@fragment
fn blur_factors(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let depth = unpack_geometry(textureLoad(geometry, vec2<i32>(at.xy), 0)).x;
    let circle = circle_of(depth);
    let q = abs(circle) / lens.largest_px;
    let factors = vec4<f32>(round(q * lens.steps), q, select(1.0, -1.0, circle < 0.0), 1.0);
    return select(vec4<f32>(0.0), factors, depth > 0.0);
}

// Wang (2) and (3) for one channel.
fn mixed_channel(a: f32, b: f32) -> f32 {
    let low = min(a, b);
    let high = max(a, b);
    let f = low / max(high, 1e-20);
    return select(high + low * f, wang.mix_ratio * (a + b), f > wang.mix_ratio);
}

fn mixed(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(mixed_channel(a.r, b.r), mixed_channel(a.g, b.g), mixed_channel(a.b, b.b), mixed_channel(a.a, b.a));
}

@fragment
fn spread(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let around = textureLoad(around_tiles, p / lens.side_px, 0);
    let reach = select(-1, min(i32(ceil(around.y)) + wang.margin, wang.half_side), around.w > 0.0);
    var sum = vec4<f32>(0.0);
    var steps: array<vec4<f32>, MAX_STEPS + 1>;
    for (var y = -reach; y <= reach; y++) {
        for (var x = -reach; x <= reach; x++) {
            let away = vec2<i32>(x, y);
            let q = p - away;
            let factor = textureLoad(factors, q, 0);
            let step = i32(factor.x);
            let place = vec2<i32>(wang.half_side) + i32(factor.z) * away;
            let share = textureLoad(operators, place + vec2<i32>(0, step * (2 * wang.half_side + 1)), 0).x;
            let there = factor.w > 0.0 && all(q >= vec2<i32>(0)) && all(q < lens.size);
            let light = select(vec4<f32>(0.0), share * textureLoad(color, q, 0), there);
            if printed {
                steps[step] += light;
            } else {
                sum += light;
            }
        }
    }
    if printed {
        for (var step = MAX_STEPS; step >= 0; step--) {
            sum = mixed(sum, steps[step]);
        }
        sum.a = min(sum.a, 1.0);
    } else {
        // Nothing covers a pixel more than once.
        sum /= max(sum.a, 1.0);
    }
    let own = textureLoad(factors, p, 0);
    // Wang (4).
    let blended = own.w > 0.0 && own.y < wang.blend_below;
    return rounded_to_half(select(sum, mix(textureLoad(color, p, 0), sum, own.y), blended));
}
