//! Measures dimensions of a loaded scene: of its triangles, and of its textures as they lie on
//! them. Lengths in millimetres.

use glam::{DVec2, DVec3};
use locard::scene::{Alpha, Material, Scene, SceneTexture};

use super::catalogue::{Axis, Measure};

/// Distance between two samples on a line.
const STEP_MM: f64 = 0.01;
/// Largest distance of a sampled point from its triangle.
const NEAR_MM: f64 = 0.1;

struct Corner {
    p_mm: DVec3,
    uv: DVec2,
}

struct Triangle<'a> {
    corners: [Corner; 3],
    normal: DVec3,
    material: &'a Material,
}

/// A model's triangles in its own axes.
pub struct Model<'a> {
    scene: &'a Scene,
    triangles: Vec<Triangle<'a>>,
}

impl Axis {
    fn unit(self) -> DVec3 {
        match self {
            Self::X => DVec3::X,
            Self::Y => DVec3::Y,
            Self::Z => DVec3::Z,
        }
    }
}

impl<'a> Model<'a> {
    pub fn of(scene: &'a Scene) -> Self {
        let parts = scene.objects.iter().flat_map(|object| &object.parts);
        let triangles = parts.flat_map(|part| {
            let mesh = &scene.meshes[part.mesh];
            mesh.indices.chunks_exact(3).map(move |t| {
                let corners = [0, 1, 2].map(|i| {
                    let vertex = &mesh.vertices[t[i] as usize];
                    let p = glam::Vec3::from(vertex.position).as_dvec3();
                    Corner {
                        p_mm: part.world_from_mesh.transform_point3(p) * 1e3,
                        uv: glam::Vec2::from(vertex.uv0).as_dvec2(),
                    }
                });
                let [a, b, c] = [0, 1, 2].map(|i| corners[i].p_mm);
                Triangle {
                    corners,
                    normal: (b - a).cross(c - a).normalize_or_zero(),
                    material: &scene.materials[mesh.material],
                }
            })
        });
        Self { scene, triangles: triangles.collect() }
    }

    /// Extents along x, y and z, and the height of the lowest point.
    pub fn size_mm(&self) -> (DVec3, f64) {
        let (low, high) = bounds(self.triangles.iter().flat_map(|t| &t.corners).map(|corner| corner.p_mm));
        (high - low, low.y)
    }

    /// A dimension in millimetres, or a reflectance.
    pub fn measure(&self, measure: &Measure) -> f64 {
        match measure {
            Measure::Section { axis, at_mm, along, material } => {
                let points = self.section(*axis, *at_mm, material.as_deref());
                extent(points.into_iter(), *along)
            }
            Measure::SmallestDiameter { at_y_mm } => {
                let radii = self.section(Axis::Y, *at_y_mm, None).into_iter().map(|p| p.with_y(0.0).length());
                2.0 * radii.fold(f64::INFINITY, f64::min)
            }
            Measure::Part { material, along } => {
                let own = self.triangles.iter().filter(|t| t.material.name == *material);
                extent(own.flat_map(|t| &t.corners).map(|corner| corner.p_mm), *along)
            }
            Measure::Print { along } => self.print_mm(*along),
            Measure::Pitch { from_mm, to_mm, count } => {
                let edges = self.edges_mm(*from_mm, *to_mm);
                assert_eq!(edges.len(), 2 * count, "number of edges on the line: {edges:?}");
                let middle = |n: usize| 0.5 * (edges[2 * n] + edges[2 * n + 1]);
                let pitch = (middle(count - 1) - middle(0)) / (count - 1) as f64;
                for n in 0..*count {
                    let off = middle(n) - middle(0) - n as f64 * pitch;
                    assert!(off.abs() < 0.05, "mark {n} is {off:.3} mm off an even scale");
                }
                pitch
            }
            Measure::Outer { from_mm, to_mm } => {
                let edges = self.edges_mm(*from_mm, *to_mm);
                edges[edges.len() - 1] - edges[0]
            }
            Measure::Inner { from_mm, to_mm } => {
                let edges = self.edges_mm(*from_mm, *to_mm);
                edges[edges.len() - 2] - edges[1]
            }
            Measure::Color { at_mm } => {
                let (triangle, uv) = self.on_surface(DVec3::from(*at_mm));
                let texture = self.texture(triangle);
                f64::from(texture.linear(texture.texel(uv)[1]))
            }
        }
    }

    fn texture(&self, triangle: &Triangle) -> &'a SceneTexture {
        &self.scene.textures[triangle.material.base_color_texture.unwrap().texture]
    }

    /// Intersections of the triangles' sides with a plane.
    fn section(&self, axis: Axis, at_mm: f64, material: Option<&str>) -> Vec<DVec3> {
        let own = self.triangles.iter().filter(|t| material.is_none_or(|name| t.material.name == name));
        let sides = own.flat_map(|t| [0, 1, 2].map(|i| [t.corners[i].p_mm, t.corners[(i + 1) % 3].p_mm]));
        let crossing = |[a, b]: [DVec3; 2]| {
            let [from, to] = [a, b].map(|p| p.dot(axis.unit()) - at_mm);
            (from * to < 0.0).then(|| a.lerp(b, from / (from - to)))
        };
        let points: Vec<DVec3> = sides.filter_map(crossing).collect();
        assert!(!points.is_empty(), "nothing at {at_mm} mm");
        points
    }

    /// The triangle that faces up or forward at a point, and its texture coordinates there.
    fn on_surface(&self, p_mm: DVec3) -> (&Triangle<'a>, DVec2) {
        let hit = self.triangles.iter().filter(|t| t.normal.y + t.normal.z > 0.0).find_map(|t| {
            let [a, b, c] = [0, 1, 2].map(|i| &t.corners[i]);
            let (u, v, w) = (b.p_mm - a.p_mm, c.p_mm - a.p_mm, p_mm - a.p_mm);
            let area = u.cross(v).dot(t.normal);
            let (s, r) = (w.cross(v).dot(t.normal) / area, u.cross(w).dot(t.normal) / area);
            let is_inside = w.dot(t.normal).abs() < NEAR_MM && s > -1e-6 && r > -1e-6 && s + r < 1.0 + 1e-6;
            is_inside.then(|| (t, a.uv + s * (b.uv - a.uv) + r * (c.uv - a.uv)))
        });
        hit.unwrap_or_else(|| panic!("no surface at {p_mm} mm"))
    }

    /// Positions on a line at which the surface becomes dark or light again, in the middle between
    /// both extremes.
    fn edges_mm(&self, from_mm: [f64; 3], to_mm: [f64; 3]) -> Vec<f64> {
        let (from, to) = (DVec3::from(from_mm), DVec3::from(to_mm));
        let length = from.distance(to);
        let count = (length / STEP_MM).round() as usize;
        let darkness: Vec<f64> = (0..=count)
            .map(|n| {
                let (triangle, uv) = self.on_surface(from.lerp(to, n as f64 / count as f64));
                self.texture(triangle).darkness(uv, triangle.material.alpha == Alpha::Blend)
            })
            .collect();
        let (low, high) = darkness.iter().fold((1.0f64, 0.0f64), |(low, high), &v| (low.min(v), high.max(v)));
        let off: Vec<f64> = darkness.iter().map(|v| v - 0.5 * (low + high)).collect();
        let crossings = off.windows(2).enumerate().filter(|(_, pair)| (pair[0] < 0.0) != (pair[1] < 0.0));
        let step = length / count as f64;
        crossings.map(|(n, pair)| step * (n as f64 + pair[0] / (pair[0] - pair[1]))).collect()
    }

    /// Extent of a decal's picture where it has half of its largest opacity.
    fn print_mm(&self, along: Axis) -> f64 {
        let top = self.triangles.iter().filter(|t| t.normal.y > 0.9);
        let size = bounds(top.clone().flat_map(|t| &t.corners).map(|corner| corner.p_mm));
        let texture = self.texture(top.clone().next().unwrap());
        let (width, height) = (texture.width as usize, texture.height as usize);
        let alpha = |x: usize, y: usize| f64::from(texture.rgba[4 * (y * width + x) + 3]);
        let level = 0.5 * f64::from(texture.rgba.chunks_exact(4).map(|p| p[3]).max().unwrap());
        let is_x = matches!(along, Axis::X);
        let (lines, steps) = if is_x { (height, width) } else { (width, height) };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for line in 0..lines {
            let at = |step: usize| if is_x { alpha(step, line) } else { alpha(line, step) };
            for step in 1..steps {
                let (a, b) = (at(step - 1) - level, at(step) - level);
                if (a < 0.0) != (b < 0.0) {
                    // Pixel middles are at +0.5.
                    let crossing = step as f64 - 0.5 + a / (a - b);
                    (low, high) = (low.min(crossing), high.max(crossing));
                }
            }
        }
        (high - low) / steps as f64 * (size.1 - size.0).dot(along.unit())
    }
}

/// Sampling of a texture without repetition.
trait Sample {
    fn texel(&self, uv: DVec2) -> [u8; 4];
    fn darkness(&self, uv: DVec2, by_alpha: bool) -> f64;
}

impl Sample for SceneTexture {
    /// The nearest texel.
    fn texel(&self, uv: DVec2) -> [u8; 4] {
        let [x, y] = [(uv.x, self.width), (uv.y, self.height)]
            .map(|(at, side)| ((at * f64::from(side)).max(0.0) as usize).min(side as usize - 1));
        let first = 4 * (y * self.width as usize + x);
        self.rgba[first..first + 4].try_into().unwrap()
    }

    /// Opacity, or one minus the green code, 0 to 1, bilinear.
    fn darkness(&self, uv: DVec2, by_alpha: bool) -> f64 {
        let size = DVec2::new(f64::from(self.width), f64::from(self.height));
        let at = uv * size - 0.5;
        let (cell, f) = (at.floor(), at - at.floor());
        let value = |dx: f64, dy: f64| {
            let rgba = self.texel((cell + DVec2::new(dx, dy) + 0.5) / size);
            if by_alpha { f64::from(rgba[3]) / 255.0 } else { 1.0 - f64::from(rgba[1]) / 255.0 }
        };
        let row = |dy: f64| value(0.0, dy) * (1.0 - f.x) + value(1.0, dy) * f.x;
        row(0.0) * (1.0 - f.y) + row(1.0) * f.y
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p))).unwrap()
}

fn extent(points: impl Iterator<Item = DVec3>, along: Axis) -> f64 {
    let (low, high) = bounds(points);
    (high - low).dot(along.unit())
}
