// Four samples to one pixel: mean colour, the nearest depth, and the velocity there.
// @import shared/layer
struct Resolve {
    size: vec2<f32>,      // of the targets, px
    first: vec2<u32>,     // column and row of the first drawn cell in the net
    columns: u32,         // drawn cells per row
    net_columns: u32,     // cells per row of the net
    side_px: f32,         // of a cell
    near_m: f32,          // plane
    far_m: f32,           // far plane of parallel rays, else 0
}
@group(0) @binding(0) var<uniform> resolve: Resolve;
@group(0) @binding(1) var color: texture_multisampled_2d<f32>;
@group(0) @binding(2) var depth: texture_depth_multisampled_2d;
// At the cells' corners: velocity at infinite distance, and its change with nearness, px/s;
// gradient of the rows' time, s/px (src/render/motion.rs).
struct Node { motion: vec4<f32>, row_time: vec2<f32>, unused: vec2<f32> }
@group(0) @binding(3) var<storage, read> nodes: array<Node>;

struct Corner {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(linear) motion: vec4<f32>,
    @location(1) @interpolate(linear) row_time: vec2<f32>,
}

// A corner of a cell's quad, in Z order.
@vertex
fn cell(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let columns = resolve.columns;
    let at = vec2<u32>(instance % columns + (vertex & 1u), instance / columns + (vertex >> 1u));
    let device = vec2<f32>(at) * resolve.side_px / resolve.size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    let place = at + resolve.first;
    let node = nodes[place.y * (resolve.net_columns + 1u) + place.x];
    return Corner(vec4<f32>(device, 0.0, 1.0), node.motion, node.row_time);
}

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32> }

@fragment
fn main(in: Corner) -> Out {
    let p = vec2<i32>(in.at.xy);
    var sum = vec4<f32>(0.0);
    // Depth is reversed: near / z, or from 1 at the near to 0 at the far plane.
    var nearness = 0.0;
    for (var i = 0; i < 4; i++) {
        sum += textureLoad(color, p, i);
        nearness = max(nearness, textureLoad(depth, p, i));
    }
    var depth_m = resolve.near_m / max(nearness, 1e-30);
    if resolve.far_m > 0.0 {
        depth_m = mix(resolve.far_m, resolve.near_m, nearness);
    }
    let velocity = in.motion.xy + in.motion.zw * nearness;
    // Something that moves as fast as rows are read would be exposed without end.
    let geometry = pack_geometry(depth_m, velocity / max(1.0 - dot(in.row_time, velocity), 0.1));
    return Out(sum * 0.25, select(vec4<u32>(0u), geometry, sum.a > 0.0 && nearness > 0.0));
}
