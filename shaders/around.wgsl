// The picture of a camera that sees all around, gathered from views around it (the sides of a cube,
// drawn finer).
//
// Each pixel is the mean of places inside it. Each place is interpolated between four texels of the
// view that its direction goes through. Depth becomes distance from the camera. Velocity becomes
// the picture's: the chord over the exposure, by the shorter way round. Occlusion by the real scene
// is left out here.
// @import shared/fullscreen
// @import shared/layer

override fisheye: bool = false;       // a fisheye; otherwise longitude and latitude
override thin_prism: bool = false;    // the fisheye has tangential and thin-prism terms

const PI: f32 = 3.14159265;
// Places per side of a pixel.
const PLACES: i32 = 4;

struct Around {
    focal_px: vec2<f32>,
    middle_px: vec2<f32>,
    lens: vec4<f32>,          // k1 to k4 of a fisheye
    decentring: vec4<f32>,    // p1, p2, sx1, sy1 of a fisheye with thin prism
    in_picture: vec2<f32>,    // where the target begins
    size_px: vec2<f32>,       // of the picture
    valid_angle: f32,         // of a fisheye, rad
    rim_slope: f32,           // at the valid angle
    rim_radius: f32,          // at the valid angle
    step_s: f32,              // half the time step for velocity
    max_px_per_s: f32,       // largest velocity
    view_focal: f32,          // texels from a view's middle to 45° off its axis
    view_middle: f32,         // coordinate of its middle
    tolerance_m: f32,         // how much nearer the real scene must be to hide
    // For each view: x0, y0, x1, y1 of the part that is drawn, and its axes in the camera's.
    drawn: array<vec4<f32>, 6>,
    right: array<vec4<f32>, 6>,
    down: array<vec4<f32>, 6>,
    forward: array<vec4<f32>, 6>,
}

@group(0) @binding(0) var<uniform> around: Around;
@group(0) @binding(1) var real_depth: texture_2d<f32>;  // distance, m; 0: unknown
@group(0) @binding(2) var color0: texture_2d<f32>;
@group(0) @binding(3) var color1: texture_2d<f32>;
@group(0) @binding(4) var color2: texture_2d<f32>;
@group(0) @binding(5) var color3: texture_2d<f32>;
@group(0) @binding(6) var color4: texture_2d<f32>;
@group(0) @binding(7) var color5: texture_2d<f32>;
@group(0) @binding(8) var geometry0: texture_2d<u32>;
@group(0) @binding(9) var geometry1: texture_2d<u32>;
@group(0) @binding(10) var geometry2: texture_2d<u32>;
@group(0) @binding(11) var geometry3: texture_2d<u32>;
@group(0) @binding(12) var geometry4: texture_2d<u32>;
@group(0) @binding(13) var geometry5: texture_2d<u32>;

fn color_at(view: u32, p: vec2<i32>) -> vec4<f32> {
    switch view {
        case 0u: { return textureLoad(color0, p, 0); }
        case 1u: { return textureLoad(color1, p, 0); }
        case 2u: { return textureLoad(color2, p, 0); }
        case 3u: { return textureLoad(color3, p, 0); }
        case 4u: { return textureLoad(color4, p, 0); }
        default: { return textureLoad(color5, p, 0); }
    }
}

fn geometry_at(view: u32, p: vec2<i32>) -> vec4<f32> {
    var g: vec4<u32>;
    switch view {
        case 0u: { g = textureLoad(geometry0, p, 0); }
        case 1u: { g = textureLoad(geometry1, p, 0); }
        case 2u: { g = textureLoad(geometry2, p, 0); }
        case 3u: { g = textureLoad(geometry3, p, 0); }
        case 4u: { g = textureLoad(geometry4, p, 0); }
        default: { g = textureLoad(geometry5, p, 0); }
    }
    return unpack_geometry(g);
}

// A fisheye's θ_d for an angle, and its slope there, within the valid angle.
fn radius_slope(theta: f32) -> vec2<f32> {
    let k = around.lens;
    let t = theta * theta;
    return vec2<f32>(
        theta * (1.0 + t * (k.x + t * (k.y + t * (k.z + t * k.w)))),
        1.0 + t * (3.0 * k.x + t * (5.0 * k.y + t * (7.0 * k.z + t * 9.0 * k.w))),
    );
}

// Tangential and thin-prism terms at θ times the direction, which ends at the valid angle
// (camera/distortion.rs).
fn decentring(p: vec2<f32>) -> vec2<f32> {
    let c = around.decentring;
    let r2 = dot(p, p);
    return vec2<f32>(
        2.0 * c.x * p.x * p.y + c.y * (r2 + 2.0 * p.x * p.x) + c.z * r2,
        c.x * (r2 + 2.0 * p.y * p.y) + 2.0 * c.y * p.x * p.y + c.w * r2,
    );
}

// A fisheye's angle from the axis at a radius of its radial part.
fn fisheye_angle(r: f32) -> f32 {
    let valid = around.valid_angle;
    var theta = valid + (r - around.rim_radius) / around.rim_slope;
    if r <= around.rim_radius {
        // Newton's method, kept between bounds.
        var low = 0.0;
        var high = valid;
        theta = min(r, valid);
        for (var i = 0; i < 12; i++) {
            let f = radius_slope(theta);
            let off = f.x - r;
            if off > 0.0 { high = theta; } else { low = theta; }
            let newton = theta - off / f.y;
            theta = select(0.5 * (low + high), newton, newton >= low && newton <= high);
        }
    }
    return theta;
}

// The direction (unit length) of a place in the picture, and 1. 0 where nothing is seen
// (camera/distortion.rs).
fn direction(at_px: vec2<f32>) -> vec4<f32> {
    var p = (at_px - around.middle_px) / around.focal_px;
    if !fisheye {
        // Rows continue over the poles.
        return vec4<f32>(sin(p.x) * cos(p.y), sin(p.y), cos(p.x) * cos(p.y), 1.0);
    }
    let valid = around.valid_angle;
    if thin_prism {
        // The radial part, by fixed-point iteration.
        let distorted = p;
        for (var i = 0; i < 8; i++) {
            let r = length(p);
            p = distorted - decentring(p / max(r, 1e-12) * min(fisheye_angle(r), valid));
        }
    }
    let r = length(p);
    let theta = fisheye_angle(r);
    let is_seen = theta <= valid || theta < 0.5 * PI;
    let towards = p / max(r, 1e-12);
    return vec4<f32>(towards * sin(theta), cos(theta), select(0.0, 1.0, is_seen));
}

// Where a direction lands in the picture.
fn place(d: vec3<f32>) -> vec2<f32> {
    var p: vec2<f32>;
    if fisheye {
        let r = length(d.xy);
        let theta = atan2(r, d.z);
        let valid = min(theta, around.valid_angle);
        p = d.xy / max(r, 1e-12) * (radius_slope(valid).x + around.rim_slope * (theta - valid));
        if thin_prism {
            p += decentring(d.xy / max(r, 1e-12) * valid);
        }
    } else {
        p = vec2<f32>(atan2(d.x, d.z), atan2(d.y, length(d.xz)));
    }
    return p * around.focal_px + around.middle_px;
}

// The place nearest to `to` among those that show the same as `at`: a full turn away, or over a
// pole.
fn nearest(at: vec2<f32>, to: vec2<f32>) -> vec2<f32> {
    if fisheye {
        return at;
    }
    let size = around.size_px;
    let half_turn = at.x + 0.5 * size.x;
    var best = at;
    var shortest = 1e30;
    for (var i = 0; i < 3; i++) {
        var p = select(at, vec2<f32>(half_turn, select(-at.y, 2.0 * size.y - at.y, i == 2)), i > 0);
        p.x += size.x * round((to.x - p.x) / size.x);
        let far = distance(p, to);
        if far < shortest {
            best = p;
            shortest = far;
        }
    }
    return best;
}

fn view_of(d: vec3<f32>) -> u32 {
    let a = abs(d);
    if a.z >= a.x && a.z >= a.y {
        return select(1u, 0u, d.z > 0.0);
    }
    if a.x >= a.y {
        return select(2u, 3u, d.x > 0.0);
    }
    return select(4u, 5u, d.y > 0.0);
}

// In texels from the view's corner.
fn on_view(view: u32, d: vec3<f32>) -> vec2<f32> {
    let p = vec2<f32>(dot(d, around.right[view].xyz), dot(d, around.down[view].xyz));
    return p / dot(d, around.forward[view].xyz) * around.view_focal + around.view_middle;
}

fn from_view(view: u32, q: vec2<f32>) -> vec3<f32> {
    let p = (q - around.view_middle) / around.view_focal;
    return p.x * around.right[view].xyz + p.y * around.down[view].xyz + around.forward[view].xyz;
}

// Whether a pixel this wide (texels) may see anything drawn in any view.
fn may_see(d: vec3<f32>, wide: f32) -> bool {
    var sees = false;
    for (var view = 0u; view < 6u; view++) {
        let q = on_view(view, d);
        let r = around.drawn[view];
        let before = dot(d, around.forward[view].xyz) > 0.3;
        sees = sees || (before && all(q >= r.xy - wide) && all(q <= r.zw + wide) && r.z > r.x);
    }
    return sees;
}

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32> }

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let corner = around.in_picture + floor(at.xy);
    let wall = textureLoad(real_depth, min(vec2<i32>(at.xy), vec2<i32>(textureDimensions(real_depth)) - 1), 0).r;
    let hidden_from = select(1e30, wall + around.tolerance_m, wall > 0.0);

    let a = direction(corner);
    let b = direction(corner + 1.0);
    // At a view's rim, texels are up to three times as fine.
    let wide = 4.0 + 6.0 * distance(a.xyz, b.xyz) * around.view_focal;
    if a.w * b.w > 0.0 && !may_see(direction(corner + 0.5).xyz, wide) {
        return Out(vec4<f32>(0.0), vec4<u32>(0u));
    }

    var sum = vec4<f32>(0.0);
    var nearest_m = 1e30;
    var seen_at = vec2<f32>(0.0);
    var seen_view = 0u;
    var seen_velocity = vec2<f32>(0.0);
    for (var n = 0; n < PLACES * PLACES; n++) {
        let inside = (vec2<f32>(f32(n % PLACES), f32(n / PLACES)) + 0.5) / f32(PLACES);
        let d = direction(corner + inside);
        let view = view_of(d.xyz);
        let q = on_view(view, d.xyz);
        let r = around.drawn[view];
        if d.w == 0.0 || any(q < r.xy - 0.5) || any(q >= r.zw + 0.5) {
            continue;
        }
        let base = floor(q - 0.5);
        let f = q - 0.5 - base;
        for (var i = 0; i < 4; i++) {
            let step = vec2<f32>(f32(i & 1), f32(i >> 1u));
            let texel = base + step;
            if any(texel < r.xy) || any(texel >= r.zw) {
                continue;
            }
            let p = vec2<i32>(texel - r.xy);
            let color = color_at(view, p);
            // Geometry is known only where there is colour.
            if color.a == 0.0 {
                continue;
            }
            let g = geometry_at(view, p);
            let from_axis = (texel + 0.5 - around.view_middle) / around.view_focal;
            let distance_m = g.x * sqrt(1.0 + dot(from_axis, from_axis));
            if distance_m > hidden_from {
                continue;
            }
            let share = select(1.0 - f, f, step > vec2<f32>(0.5));
            sum += color * (share.x * share.y);
            if distance_m < nearest_m {
                nearest_m = distance_m;
                seen_at = texel + 0.5;
                seen_view = view;
                seen_velocity = g.zw;
            }
        }
    }
    if sum.a == 0.0 {
        return Out(vec4<f32>(0.0), vec4<u32>(0u));
    }
    let step_s = around.step_s;
    let here = corner + 0.5;
    let before = nearest(place(from_view(seen_view, seen_at - step_s * seen_velocity)), here);
    let after = nearest(place(from_view(seen_view, seen_at + step_s * seen_velocity)), here);
    var velocity = (after - before) / (2.0 * step_s);
    velocity *= min(1.0, around.max_px_per_s / max(length(velocity), 1e-6));
    return Out(sum / f32(PLACES * PLACES), pack_geometry(nearest_m, velocity));
}
