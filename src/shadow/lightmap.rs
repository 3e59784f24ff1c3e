//! Precomputed light on objects' own surfaces: ambient occlusion, indirect light and direct
//! visibility.
//!
//! Objects are static, so that incident light is computed once for each texel of a part's lightmap
//! (render/unwrap.rs), by ray casting ([`BakeScene`]):
//!
//! - sky visibility a = Σ L·V·cos θ / Σ L·cos θ over the environment's rays, V = 0 where a ray hits
//!   an object; a ray that continues to a real floor is attenuated by the floor's planar shadow;
//! - indirect light b = Σ ρ·E·cos θ·Δω/π over the rays that hit, with the albedo ρ and the
//!   irradiance E of the triangle that is hit;
//! - the visible fraction of each sun's and lamp's disc.
//!
//! White matt then has the radiance a·L_sky + b + Σ visibility · L_light. E is computed once per
//! cluster of coplanar neighbours, in the middle of its first triangle. Rays below a triangle's own
//! plane are skipped: a tessellated curved surface would occlude itself at its edges (the
//! terminator problem).
//!
//! Not modelled: more than one bounce; a shadow's edge within a cluster; mirrors; transmission
//! through glass; occlusion and reflection by real objects beside the floor.

use glam::{Mat3, Vec3};

use super::bake_scene::{BakeScene, Incident, SurfacePoint};
use crate::digest::{Digester, Digestible};
use crate::parallel::{over_rows, processors};
use crate::render::{Lightmap, TexelPoint, UnwrappedMesh};

/// Texel stride of the first sampling pass.
const COARSEST_STRIDE: i32 = 4;
/// Largest spread of incident light, as a fraction of all light, and smallest cosine between
/// normals (11°), over which it is interpolated.
const MAX_SPREAD: f32 = 0.04;
const MIN_NORMAL_COSINE: f32 = 0.98;
/// Texels per parallel task.
const TEXELS_PER_TASK: usize = 32;
/// A texel that no place of the surface covers: all light arrives.
const UNOCCLUDED: [f32; 4] = [1.0; 4];

/// A part's surface, placed in the axes of its [`BakeScene`].
pub struct PartSurface<'a> {
    pub unwrapped: &'a UnwrappedMesh,
    pub scene_from_mesh: glam::DAffine3,
    pub double_sided: bool,
}

impl Digestible for PartSurface<'_> {
    fn digest(&self, into: &mut Digester) {
        let Self { unwrapped: UnwrappedMesh { corners, indices, side }, scene_from_mesh, double_sided } = self;
        into.add_numbers(corners);
        into.add_numbers(indices);
        into.add(side);
        into.add(scene_from_mesh);
        into.add(double_sided);
    }
}

impl PartSurface<'_> {
    /// `side`: 1 for the front, -1 for the back.
    fn point(&self, place: &TexelPoint, side: f32) -> SurfacePoint {
        let matrix = self.scene_from_mesh.matrix3.as_mat3();
        let own = &self.unwrapped.indices[3 * place.triangle as usize..][..3];
        let corners = [0, 1, 2].map(|n| &self.unwrapped.corners[own[n] as usize].vertex);
        let in_scene = |p: [f32; 3]| self.scene_from_mesh.transform_point3(Vec3::from(p).as_dvec3()).as_vec3();
        let positions = corners.map(|c| in_scene(c.position));
        let interpolated = |values: [Vec3; 3]| (0..3).map(|n| place.weights[n] * values[n]).sum::<Vec3>();
        let face_normal = (positions[1] - positions[0]).cross(positions[2] - positions[0]);
        // Counter-clockwise as seen from outside, also of mirrored parts.
        let face_normal = face_normal.normalize_or_zero() * matrix.determinant().signum() * side;
        let normals = cofactors(matrix) * matrix.determinant().signum();
        let normal = (normals * interpolated(corners.map(|c| Vec3::from(c.normal)))).normalize_or_zero() * side;
        SurfacePoint {
            position: interpolated(positions),
            normal: if normal == Vec3::ZERO { face_normal } else { normal },
            face_normal,
        }
    }
}

/// The inverse transpose times the determinant.
fn cofactors(m: Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// Bakes the lightmap of a surface.
pub fn lightmap(surface: &PartSurface<'_>, scene: &BakeScene<'_>) -> Lightmap {
    let places = surface.unwrapped.places();
    let side = surface.unwrapped.side;
    let layer_count = 2 + scene.light_count().saturating_sub(2).div_ceil(4);
    let mut layers = Vec::new();
    for facing in if surface.double_sided { &[1.0f32, -1.0][..] } else { &[1.0] } {
        let mut own = vec![vec![UNOCCLUDED; (side * side) as usize]; layer_count];
        let points: Vec<SurfacePoint> = places.iter().map(|place| surface.point(place, *facing)).collect();
        for (place, incident) in places.iter().zip(AdaptiveSampler::new(scene, &places, &points, side).incident()) {
            let texel = place.texel as usize;
            let visibility = |n: usize| incident.light_visibility.get(n).copied().unwrap_or(1.0);
            own[0][texel] = incident.sky_visibility.extend(visibility(0)).to_array();
            own[1][texel] = incident.indirect.extend(visibility(1)).to_array();
            for (n, visibility) in incident.light_visibility.iter().enumerate().skip(2) {
                own[2 + (n - 2) / 4][texel][(n - 2) % 4] = *visibility;
            }
        }
        layers.extend(own);
    }
    Lightmap { side, layers }
}

/// Samples incident light coarse to fine: every fourth texel of every fourth row first. Between
/// texels of one surface with nearly equal light it is interpolated, elsewhere it is sampled.
struct AdaptiveSampler<'a> {
    scene: &'a BakeScene<'a>,
    places: &'a [TexelPoint],
    points: &'a [SurfacePoint],
    side: i32,
    /// Index into `places` for each texel that has one.
    place_of_texel: Vec<Option<u32>>,
}

impl<'a> AdaptiveSampler<'a> {
    fn new(scene: &'a BakeScene<'a>, places: &'a [TexelPoint], points: &'a [SurfacePoint], side: u32) -> Self {
        let mut place_of_texel = vec![None; (side * side) as usize];
        (0..).zip(places).for_each(|(n, place)| place_of_texel[place.texel as usize] = Some(n));
        Self { scene, places, points, side: side as i32, place_of_texel }
    }

    /// Incident light at each place.
    fn incident(&self) -> Vec<Incident> {
        let mut incident: Vec<Option<Incident>> = vec![None; self.places.len()];
        for stride in [COARSEST_STRIDE, COARSEST_STRIDE / 2, COARSEST_STRIDE / 4] {
            let is_on_grid = |n: &usize| {
                let (x, y) = self.texel(*n);
                incident[*n].is_none() && x % stride == 0 && y % stride == 0
            };
            let on_grid: Vec<usize> = (0..self.places.len()).filter(is_on_grid).collect();
            let mut sampled: Vec<Option<Incident>> = vec![None; on_grid.len()];
            over_rows(&mut sampled, TEXELS_PER_TASK, processors(), |task, sampled| {
                for (n, sampled) in on_grid[task * TEXELS_PER_TASK..].iter().zip(sampled) {
                    let between =
                        if stride < COARSEST_STRIDE { self.interpolated(*n, stride, &incident) } else { None };
                    *sampled = Some(between.unwrap_or_else(|| self.scene.incident(&self.points[*n])));
                }
            });
            on_grid.iter().zip(sampled).for_each(|(n, sampled)| incident[*n] = sampled);
        }
        incident.into_iter().flatten().collect()
    }

    fn texel(&self, place: usize) -> (i32, i32) {
        let texel = self.places[place].texel as i32;
        (texel % self.side, texel / self.side)
    }

    /// The mean of the known neighbours on the coarser grid, if they are nearly equal.
    fn interpolated(&self, n: usize, stride: i32, sampled: &[Option<Incident>]) -> Option<Incident> {
        let (x, y) = self.texel(n);
        // The ends of its row, those of its column, or the corners around it.
        let neighbours: &[(i32, i32)] = match (x % (2 * stride) == 0, y % (2 * stride) == 0) {
            (false, true) => &[(-1, 0), (1, 0)],
            (true, false) => &[(0, -1), (0, 1)],
            _ => &[(-1, -1), (1, -1), (-1, 1), (1, 1)],
        };
        let own = &self.points[n];
        let mut mean = Incident::none(self.scene.light_count());
        let (mut centre, mut farthest) = (Vec3::ZERO, 0.0f32);
        let (mut low, mut high) = (mean.clone(), mean.clone());
        let weight = 1.0 / neighbours.len() as f32;
        for (n, (dx, dy)) in neighbours.iter().enumerate() {
            let (x, y) = (x + dx * stride, y + dy * stride);
            let inside = (0..self.side).contains(&x) && (0..self.side).contains(&y);
            let other = self.place_of_texel[if inside { (y * self.side + x) as usize } else { return None }]? as usize;
            let (point, incident) = (&self.points[other], sampled[other].as_ref()?);
            if point.normal.dot(own.normal) < MIN_NORMAL_COSINE {
                return None;
            }
            mean.add(incident, weight);
            centre += weight * point.position;
            farthest = farthest.max(point.position.distance(own.position));
            if n == 0 {
                (low, high) = (incident.clone(), incident.clone());
            } else {
                (low, high) = (low.zip_with(incident, f32::min), high.zip_with(incident, f32::max));
            }
        }
        // Neighbours on the lightmap need not be neighbours on the surface.
        let is_one_surface = centre.distance(own.position) < 0.2 * farthest;
        (is_one_surface && high.is_within(&low, MAX_SPREAD)).then_some(mean)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DAffine3, DVec3, Vec2};

    use super::super::bake_scene::BakeInputs;
    use super::super::occluders::Occluders;
    use super::super::planar_shadow::PlanarShadow;
    use super::super::receiver_plane::ReceiverPlane;
    use super::super::sky::EnvSample;
    use super::*;
    use crate::digest::Digest;
    use crate::memo::ByAddress;
    use crate::scene::{Lighting, PointLight, Sun};

    /// All that a lightmap depends on.
    #[derive(Clone)]
    struct Inputs {
        occluders: Occluders,
        environment: Vec<EnvSample>,
        lighting: Lighting,
        planar_shadows: Vec<PlanarShadow>,
        unwrapped: UnwrappedMesh,
        scene_from_mesh: DAffine3,
        double_sided: bool,
    }

    impl Inputs {
        fn digest(&self) -> Digest {
            let Self { occluders, environment, lighting, planar_shadows, unwrapped, scene_from_mesh, double_sided } =
                self;
            let inputs = BakeInputs { occluders, environment, lighting, planar_shadows, max_lights: [1, 3] };
            let mut digester = Digester::default();
            digester.add(&inputs);
            digester.add(&PartSurface { unwrapped, scene_from_mesh: *scene_from_mesh, double_sided: *double_sided });
            digester.finish()
        }
    }

    #[test]
    fn any_input_of_a_lightmap_changes_its_digest() {
        let lamp = PointLight {
            position_in_world_m: DVec3::Z,
            color: Vec3::ONE,
            diameter_m: 0.1,
            range_m: f32::INFINITY,
            spot: None,
        };
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        let texture = crate::shadow::ShadowTexture::new(
            &Occluders::default(),
            super::super::extent::Extent { low: Vec2::ZERO, high: Vec2::ONE },
            &super::super::sky::PlaneLighting::new(
                &Lighting::default(),
                Arc::new([]),
                &ReceiverPlane::new(DVec3::ZERO, DVec3::Z),
                None,
            ),
            super::super::planar_shadow::RealOcclusion::default(),
            crate::quality::Quality::Final,
        );
        let planar_shadow = PlanarShadow {
            plane: ReceiverPlane::new(DVec3::ZERO, DVec3::Z),
            texture: ByAddress(Arc::new(texture)),
            is_beside: false,
        };
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let first = Inputs {
            occluders: Occluders {
                corners,
                triangles: vec![[0, 1, 2]],
                colors: vec![Vec3::ONE],
                parts: vec![0..1, 1..1],
            },
            environment: vec![EnvSample { towards: Vec3::Z, light: Vec3::ONE, solid_sr: 1.0 }],
            lighting: Lighting { suns: vec![sun], points: vec![lamp], ..Lighting::default() },
            planar_shadows: vec![planar_shadow],
            unwrapped: UnwrappedMesh { corners: Vec::new(), indices: vec![0, 1, 2], side: 16 },
            scene_from_mesh: DAffine3::IDENTITY,
            double_sided: false,
        };
        assert_eq!(first.digest(), first.clone().digest());
        let changes: [fn(&mut Inputs); 16] = [
            |i| i.occluders.corners[1].x = 1.0f32.next_up(),
            |i| i.occluders.triangles[0] = [0, 2, 1],
            |i| i.occluders.colors[0].y = 0.5,
            |i| i.occluders.parts[0] = 0..0,
            |i| i.environment[0].light.z = 1.0f32.next_down(),
            |i| i.environment[0].solid_sr = 2.0,
            |i| i.lighting.suns[0].diameter_rad = 0.02,
            |i| i.lighting.points[0].position_in_world_m.x = f64::MIN_POSITIVE,
            |i| i.lighting.points[0].spot = Some(Default::default()),
            |i| i.lighting.points[0].range_m = 9.0,
            |i| i.planar_shadows[0].plane.origin_m.y = 1.0,
            |i| Arc::make_mut(&mut i.planar_shadows[0].texture.0).removed[0][1] += 0.5,
            |i| i.planar_shadows.clear(),
            |i| i.unwrapped.side = 17,
            |i| i.scene_from_mesh.translation.x = 1e-12,
            |i| i.double_sided = true,
        ];
        for (n, change) in changes.into_iter().enumerate() {
            let mut other = first.clone();
            change(&mut other);
            assert_ne!(other.digest(), first.digest(), "change {n}");
        }
    }
}
