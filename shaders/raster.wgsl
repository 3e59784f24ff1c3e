// Draws triangles to multisampled colour and depth.
//
// A vertex is seen from the pose at the moment its own row is read, plus the sample's time in the
// shutter. Distortion is applied to vertices, so triangles must be fine enough.
// @import shared/surface_shading
// @import shared/lens_table

// The features of a draw call. Each combination is a pipeline of its own, so that an untextured
// object does not pay for five textures (software drivers execute both sides of an `if`).
override rolling: bool = false;                // rows have their own times
override lens: u32 = 0u;                       // the lens model
override around: bool = false;                 // one view of a picture that sees all around; rows are that picture's
override parallel: bool = false;               // rays are parallel; focal lengths are px per metre
override has_colors: bool = false;             // of vertices
override has_base_color: bool = false;         // textures
override has_metallic_roughness: bool = false;
override has_normals: bool = false;
override has_occlusion: bool = false;
override has_emissive: bool = false;
// Whether colours are converted from Rec. 709 to other primaries, by this matrix.
override converts_primaries: bool = false;
override red_of_red: f32 = 1.0;
override red_of_green: f32 = 0.0;
override red_of_blue: f32 = 0.0;
override green_of_red: f32 = 0.0;
override green_of_green: f32 = 1.0;
override green_of_blue: f32 = 0.0;
override blue_of_red: f32 = 0.0;
override blue_of_green: f32 = 0.0;
override blue_of_blue: f32 = 1.0;
override unlit: bool = false;
override masked: bool = false;
override blended: bool = false;
override hidden_by_depth: bool = false;        // the real scene's depth is known
override depth_on_grid: bool = false;          // it is known on a grid that is coarser than the picture, or as fine
override suns: u32 = 0u;                       // number of lights
override points: u32 = 0u;
override has_map: bool = false;                // the environment is a picture
override has_lightmap: bool = false;           // it is known how much light reaches each place of the surface

// The lens models (render/pipeline.rs). 0 is OpenCV's polynomial.
const FISHEYE: u32 = 1u;
const RATIONAL: u32 = 2u;
const FIELD_OF_VIEW: u32 = 3u;
const THIN_PRISM_FISHEYE: u32 = 4u;
const ST_MAP: u32 = 5u;

const MAX_KEYS: u32 = 33u;
const MAX_SUNS: u32 = 4u;
const MAX_POINTS: u32 = 8u;
const MAX_LIGHTS: u32 = 14u; // and some that are written and not read
const ALBEDO_STEPS: f32 = 16.0;
const PI: f32 = 3.14159265;

struct View {
    rect_px: vec4<f32>,       // x0, y0, width, height of the target in the picture
    focal_px: vec2<f32>,      // fx, fy
    middle_px: vec2<f32>,     // cx, cy
    distortion: vec4<f32>,    // k1, k2, p1, p2; for a fisheye k1, k2, k3, k4
    // Rational: k4, k5, k6. Field of view: ω, 2 tan(ω/2). Thin prism: p1, p2, sx1, sy1. Table: the
    // corner of its domain, and its cells per unit.
    lens_terms: vec4<f32>,
    outer_turn: vec4<f32>,    // from a view's axes to those of the camera whose picture it belongs to
    // The camera's rotation and position at the sample time.
    rotation: vec4<f32>,
    eye: vec4<f32>,
    lens_m: vec2<f32>,        // point of the aperture that is looked through
    in_depth: vec2<f32>,      // column and row of the target in the real depth, texels
    outer_fy_px: f32,         // of the camera whose picture it belongs to
    outer_cy_px: f32,
    k3: f32,
    valid_radius: f32,        // for a fisheye an angle
    rim_slope: f32,           // at the valid radius
    near_m: f32,              // plane
    time_s: f32,              // of the sample
    readout_s: f32,
    height_px: f32,           // of the picture
    first_key_s: f32,
    keys_per_s: f32,
    last_key: f32,            // keys - 1
    tolerance_m: f32,         // of occlusion
    per_focus: f32,           // 1 / focus distance, 1/m
    parallel_to_m: f32,       // far plane of parallel rays
    per_texel: f32,           // texels of the real depth per pixel
    key_rotation: array<vec4<f32>, MAX_KEYS>,
    key_translation: array<vec4<f32>, MAX_KEYS>,
}

struct PointLight {
    position: vec4<f32>,   // around the camera, m; w = 1/range
    color: vec4<f32>,
    spot: vec4<f32>,       // axis; w = cos outer (-2: no spot)
    spot_inner: vec4<f32>, // x = cos inner
}

struct Light {
    environment: vec4<f32>, // colour where there is no picture; w: mipmap levels of the picture
    sun_towards: array<vec4<f32>, MAX_SUNS>,
    sun_color: array<vec4<f32>, MAX_SUNS>,
    points: array<PointLight, MAX_POINTS>,
    // Rows of the rotation from the world to the environment's axes.
    map_rows: array<vec4<f32>, 3>,
    strength: vec4<f32>, // x: how much is left out of the light that does not reach a surface
}

struct Material {
    base_color: vec4<f32>,
    emissive: vec4<f32>,
    metallic: f32,
    roughness: f32,
    normal_scale: f32,
    occlusion: f32,        // strength
    cutoff: f32,           // of alpha
    unused0: f32,
    unused1: f32,
    unused2: f32,
    // Two rows of each texture's transform; the w of the first row is the uv set.
    transforms: array<vec4<f32>, 10>,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> light: Light;
@group(0) @binding(2) var environment: texture_2d<f32>;
@group(0) @binding(3) var environment_sampler: sampler;
@group(0) @binding(4) var real_depth: texture_2d<f32>;
@group(0) @binding(5) var albedo_table: texture_2d<f32>;
@group(0) @binding(6) var irradiance_table: texture_2d<f32>;
@group(0) @binding(7) var lens_table: texture_2d<f32>;  // control points of displacements (camera/lens_map.rs)

@group(1) @binding(0) var<uniform> material: Material;
@group(1) @binding(1) var base_color_texture: texture_2d<f32>;
@group(1) @binding(2) var base_color_sampler: sampler;
@group(1) @binding(3) var metallic_roughness_texture: texture_2d<f32>;
@group(1) @binding(4) var metallic_roughness_sampler: sampler;
@group(1) @binding(5) var normal_texture: texture_2d<f32>;
@group(1) @binding(6) var normal_sampler: sampler;
@group(1) @binding(7) var occlusion_texture: texture_2d<f32>;
@group(1) @binding(8) var occlusion_sampler: sampler;
@group(1) @binding(9) var emissive_texture: texture_2d<f32>;
@group(1) @binding(10) var emissive_sampler: sampler;

// render/lightmap.rs has its layers.
@group(2) @binding(0) var lightmap: texture_2d_array<f32>;

struct Corner {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) tangent: vec4<f32>,
    @location(3) uv0: vec2<f32>,
    @location(4) uv1: vec2<f32>,
    @location(5) color: vec4<f32>,
    // Per object: rows of the 3×4 matrix from the mesh to world axes around the camera, the sign of
    // its determinant, and the plan's offset (px).
    @location(6) row0: vec4<f32>,
    @location(7) row1: vec4<f32>,
    @location(8) row2: vec4<f32>,
    @location(9) mirror_offset: vec3<f32>,
    @location(10) on_lightmap: vec2<f32>,
}

struct Fragment {
    @builtin(position) at: vec4<f32>,
    @location(0) position: vec3<f32>,   // world axes around the camera, m
    @location(1) normal: vec3<f32>,
    @location(2) tangent: vec4<f32>,
    @location(3) uv: vec4<f32>,
    @location(4) color: vec4<f32>,
    // Within the triangle, for beside it another island lies.
    @location(5) @interpolate(perspective, centroid) on_lightmap: vec2<f32>,
}

fn rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

// The point in the camera's axes at a time relative to the frame's.
fn in_camera(point: vec3<f32>, time_s: f32) -> vec3<f32> {
    let x = clamp((time_s - view.first_key_s) * view.keys_per_s, 0.0, view.last_key);
    let i = u32(min(floor(x), view.last_key - 1.0));
    let f = x - f32(i);
    let q = normalize(mix(view.key_rotation[i], view.key_rotation[i + 1u], f));
    // The camera's position moves along a line, as between recorded poses.
    let eye = mix(view.key_translation[i].xyz, view.key_translation[i + 1u].xyz, f);
    return rotate(q, point - eye);
}

fn distort_polynomial(p: vec2<f32>) -> vec2<f32> {
    let r2 = dot(p, p);
    let radial = 1.0 + r2 * (view.distortion.x + r2 * (view.distortion.y + r2 * view.k3));
    let tangential = vec2<f32>(
        2.0 * view.distortion.z * p.x * p.y + view.distortion.w * (r2 + 2.0 * p.x * p.x),
        view.distortion.z * (r2 + 2.0 * p.y * p.y) + 2.0 * view.distortion.w * p.x * p.y,
    );
    if lens == RATIONAL {
        let k = view.lens_terms;
        return p * (radial / (1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z)))) + tangential;
    }
    return p * radial + tangential;
}

// The model of the field of view.
fn fov_radius(r: f32) -> f32 {
    let valid = min(r, view.valid_radius);
    return atan(view.lens_terms.y * valid) / view.lens_terms.x + view.rim_slope * (r - valid);
}

// A fisheye's tangential and thin-prism terms, which end at the valid angle.
fn decentring(direction: vec2<f32>, theta: f32) -> vec2<f32> {
    let c = view.lens_terms;
    let p = direction * min(theta, view.valid_radius);
    let r2 = dot(p, p);
    return vec2<f32>(
        2.0 * c.x * p.x * p.y + c.y * (r2 + 2.0 * p.x * p.x) + c.z * r2,
        c.x * (r2 + 2.0 * p.y * p.y) + 2.0 * c.y * p.x * p.y + c.w * r2,
    );
}

fn fisheye_radius(theta: f32) -> f32 {
    let valid = min(theta, view.valid_radius);
    let k = view.distortion;
    let t = valid * valid;
    let rim = valid * (1.0 + t * (k.x + t * (k.y + t * (k.z + t * k.w))));
    return rim + view.rim_slope * (theta - valid);
}

// The row of the picture (px from its upper edge) in which a point is read. For a view of a
// fisheye: the fisheye's row.
fn row_of(p: vec3<f32>, at: vec2<f32>) -> f32 {
    if !around {
        return at.y;
    }
    let q = rotate(view.outer_turn, p);
    let r = length(q.xy);
    let theta = atan2(r, q.z);
    if lens == THIN_PRISM_FISHEYE {
        let direction = q.xy / max(r, 1e-12);
        return (direction.y * fisheye_radius(theta) + decentring(direction, theta).y) * view.outer_fy_px + view.outer_cy_px;
    }
    return q.y / max(r, 1e-12) * fisheye_radius(theta) * view.outer_fy_px + view.outer_cy_px;
}

// The lens models, continued along their tangent beyond the valid radius (camera/distortion.rs).
// Through a point l of the aperture, a point at the focus distance d projects to the same pixel as
// through the middle: (p − l)/z + l/d. Surfaces beside or behind the camera are not drawn:
// triangles end at the near plane. A fisheye that sees it is assembled from views
// (shaders/around.wgsl).
fn project(p: vec3<f32>) -> vec2<f32> {
    if parallel {
        return p.xy * view.focal_px + view.middle_px;
    }
    if around {
        return p.xy / max(p.z, 0.5 * view.near_m) * view.focal_px + view.middle_px;
    }
    let n = (p.xy - view.lens_m) / max(p.z, 0.5 * view.near_m) + view.lens_m * view.per_focus;
    let r = length(n);
    let direction = n / max(r, 1e-12);
    var d: vec2<f32>;
    if lens == FISHEYE {
        d = direction * fisheye_radius(atan(r));
    } else if lens == THIN_PRISM_FISHEYE {
        let theta = atan(r);
        d = direction * fisheye_radius(theta) + decentring(direction, theta);
    } else if lens == FIELD_OF_VIEW {
        d = direction * fov_radius(r);
    } else if lens == ST_MAP {
        d = distort_by_table(n, lens_table, view.lens_terms);
    } else {
        let valid = min(r, view.valid_radius);
        d = distort_polynomial(direction * valid) + direction * (view.rim_slope * (r - valid));
    }
    return d * view.focal_px + view.middle_px;
}

struct Seen { at_px: vec2<f32>, depth_m: f32 }

// Where a point is seen at the middle of its own row's exposure. The row's time depends on the row
// found: a contraction by readout · speed / height (≲ 0.1) per step.
fn see(point: vec3<f32>) -> Seen {
    if !rolling {
        let p = rotate(view.rotation, point - view.eye.xyz);
        return Seen(project(p), p.z);
    }
    let sample_s = view.time_s;
    let readout_s = view.readout_s;
    var p = in_camera(point, sample_s);
    var at = project(p);
    for (var i = 0; i < 4; i++) {
        let row_s = (row_of(p, at) / view.height_px - 0.5) * readout_s;
        // Rows far outside the picture are never read; their time is kept close to it.
        p = in_camera(point, sample_s + clamp(row_s, -readout_s, readout_s));
        at = project(p);
    }
    return Seen(at, p.z);
}

@vertex
fn vertex(corner: Corner) -> Fragment {
    let p = vec4<f32>(corner.position, 1.0);
    let row0 = corner.row0;
    let row1 = corner.row1;
    let row2 = corner.row2;
    let mirror = corner.mirror_offset.x;
    let position = vec3<f32>(dot(row0, p), dot(row1, p), dot(row2, p));
    let here = see(position);

    // The inverse transpose up to a positive factor: rows of cofactors, times the sign of the
    // determinant.
    let n = vec3<f32>(
        dot(cross(row1.xyz, row2.xyz), corner.normal),
        dot(cross(row2.xyz, row0.xyz), corner.normal),
        dot(cross(row0.xyz, row1.xyz), corner.normal),
    ) * mirror;
    let t = vec3<f32>(
        dot(row0.xyz, corner.tangent.xyz),
        dot(row1.xyz, corner.tangent.xyz),
        dot(row2.xyz, corner.tangent.xyz),
    );

    let local_px = here.at_px + corner.mirror_offset.yz - view.rect_px.xy;
    let device = vec2<f32>(2.0, -2.0) * local_px / view.rect_px.zw + vec2<f32>(-1.0, 1.0);
    var w = max(here.depth_m, 0.5 * view.near_m);
    // Reversed depth without a far plane: near/z, 1 at the near plane.
    var z = view.near_m;
    if parallel {
        // Linear, 1 at the near plane and 0 at the far one.
        w = 1.0;
        z = (view.parallel_to_m - here.depth_m) / (view.parallel_to_m - view.near_m);
    }
    var out: Fragment;
    out.at = vec4<f32>(device * w, z, w);
    out.position = position;
    out.normal = n;
    out.tangent = vec4<f32>(t, corner.tangent.w * mirror);
    out.uv = vec4<f32>(corner.uv0, corner.uv1);
    out.color = corner.color;
    out.on_lightmap = corner.on_lightmap;
    return out;
}

fn texture_uv(in: Fragment, index: u32) -> vec2<f32> {
    let row0 = material.transforms[2u * index];
    let row1 = material.transforms[2u * index + 1u];
    let uv = vec3<f32>(select(in.uv.xy, in.uv.zw, row0.w > 0.5), 1.0);
    return vec2<f32>(dot(row0.xyz, uv), dot(row1.xyz, uv));
}

// Print on evidence must be legible, even at a slant: four taps at four places each way across the
// pixel, from finer mipmaps. One trilinear tap blurs more than the pixel does, and drivers differ
// in how they do anisotropy.
const FINER: f32 = -1.5;

fn base_texel(uv: vec2<f32>) -> vec4<f32> {
    let x = dpdx(uv);
    let y = dpdy(uv);
    let a = 0.125 * x + 0.375 * y;
    let b = 0.375 * x - 0.125 * y;
    return 0.25 * (textureSampleBias(base_color_texture, base_color_sampler, uv + a, FINER)
        + textureSampleBias(base_color_texture, base_color_sampler, uv - a, FINER)
        + textureSampleBias(base_color_texture, base_color_sampler, uv + b, FINER)
        + textureSampleBias(base_color_texture, base_color_sampler, uv - b, FINER));
}

// Light in the footage's primaries, of light in Rec. 709 (src/camera/primaries.rs).
fn in_primaries(color: vec3<f32>) -> vec3<f32> {
    if !converts_primaries {
        return color;
    }
    return vec3<f32>(
        dot(color, vec3<f32>(red_of_red, red_of_green, red_of_blue)),
        dot(color, vec3<f32>(green_of_red, green_of_green, green_of_blue)),
        dot(color, vec3<f32>(blue_of_red, blue_of_green, blue_of_blue)),
    );
}

fn base_of(in: Fragment) -> vec4<f32> {
    var base = material.base_color;
    if has_colors {
        base *= in.color;
    }
    if has_base_color {
        base *= base_texel(texture_uv(in, 0u));
    }
    return vec4<f32>(in_primaries(base.rgb), base.a);
}

// Premultiplied, and within the range of 16-bit floats.
fn surface(in: Fragment, front: bool, base: vec4<f32>) -> vec4<f32> {
    var color = base.rgb;
    if !unlit {
        var emitted = material.emissive.rgb;
        if has_emissive {
            emitted *= textureSample(emissive_texture, emissive_sampler, texture_uv(in, 4u)).rgb;
        }
        color = shade(in, front, base.rgb) + in_primaries(emitted);
    }
    let alpha = select(1.0, clamp(base.a, 0.0, 1.0), blended);
    return vec4<f32>(min(color * alpha, vec3<f32>(60000.0)), alpha);
}

@fragment
fn whole(in: Fragment, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    return surface(in, front, base_of(in));
}

// 1 if a texel of the real depth hides the surface at a pixel. Rays are not parallel here: w is 1 /
// depth.
fn is_hidden(texel: vec2<i32>, at: vec4<f32>) -> f32 {
    let wall = textureLoad(real_depth, texel, 0).r;
    return f32(wall > 0.0 && 1.0 > (wall + view.tolerance_m) * at.w);
}

// Where one of a pixel's four samples lies, px from its middle: the standard sample locations of
// Vulkan and Direct3D.
fn sample_place(n: u32) -> vec2<f32> {
    let all = array<vec2<f32>, 4>(
        vec2<f32>(-0.125, -0.375), vec2<f32>(0.375, -0.125), vec2<f32>(-0.375, 0.125), vec2<f32>(0.125, 0.375),
    );
    return all[n];
}

// Mask of the visible samples. Occlusion is interpolated between the middles of four texels, and
// the real object ends where it is a half: its edge runs straight from texel to texel, not in
// steps.
fn samples_before_grid(at: vec4<f32>) -> u32 {
    let place = at.xy * view.per_texel + view.in_depth;
    let texel = floor(place);
    let i = vec2<i32>(texel);
    let above = vec3<f32>(is_hidden(i + vec2<i32>(-1, -1), at), is_hidden(i + vec2<i32>(0, -1), at), is_hidden(i + vec2<i32>(1, -1), at));
    let beside = vec3<f32>(is_hidden(i + vec2<i32>(-1, 0), at), is_hidden(i, at), is_hidden(i + vec2<i32>(1, 0), at));
    let below = vec3<f32>(is_hidden(i + vec2<i32>(-1, 1), at), is_hidden(i + vec2<i32>(0, 1), at), is_hidden(i + 1, at));
    var mask = 0u;
    for (var n = 0u; n < 4u; n++) {
        let off = place - texel - 0.5 + sample_place(n) * view.per_texel;
        let before = max(-off, vec2<f32>(0.0));
        let after = max(off, vec2<f32>(0.0));
        let across = vec3<f32>(before.x, 1.0 - before.x - after.x, after.x);
        let down = vec3<f32>(before.y, 1.0 - before.y - after.y, after.y);
        let hidden = dot(down, vec3<f32>(dot(above, across), dot(beside, across), dot(below, across)));
        mask |= select(0u, 1u << n, hidden <= 0.5);
    }
    return mask;
}

// Which of a pixel's four samples are covered, where parts of the surface are cut out or hidden by
// the real scene.
fn samples_of(in: Fragment, base: vec4<f32>) -> u32 {
    var mask = 0xfu;
    if masked {
        // The cut-off's edge, one pixel wide, as coverage of the four samples.
        let slope = max(fwidth(base.a), 1e-4);
        let covered = clamp((base.a - material.cutoff) / slope + 0.5, 0.0, 1.0);
        mask = (1u << u32(round(covered * 4.0))) - 1u;
    }
    if hidden_by_depth {
        if depth_on_grid {
            mask &= samples_before_grid(in.at);
        } else if is_hidden(vec2<i32>(in.at.xy + view.in_depth), in.at) > 0.0 {
            mask = 0u;
        }
    }
    return mask;
}

struct PartlyOut {
    @location(0) color: vec4<f32>,
    @builtin(sample_mask) mask: u32,
}

@fragment
fn partly(in: Fragment, @builtin(front_facing) front: bool) -> PartlyOut {
    let base = base_of(in);
    return PartlyOut(surface(in, front, base), samples_of(in, base));
}

// The depth of a blended surface, drawn after all its colours, where it is visible at all.
@fragment
fn depth_of_blended(in: Fragment) -> @builtin(sample_mask) u32 {
    let base = base_of(in);
    return select(0u, samples_of(in, base), base.a > 0.0);
}
