//! Surfaces as grids of vertices.

use glam::{Vec2, Vec3};

/// Vertices and triangles; lengths in metres.
#[derive(Default)]
pub struct Shape {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub indices: Vec<u16>,
}

/// A vertex: position in millimetres, normal of any length, texture coordinates.
pub type Corner = (Vec3, Vec3, Vec2);

impl Shape {
    /// Adds a surface of `columns` by `rows` cells; `at` returns the corner for s and t from 0 to
    /// 1. The triangles' fronts face along the normals.
    pub fn grid(&mut self, columns: u16, rows: u16, at: impl Fn(f32, f32) -> Corner) {
        let first = self.positions.len() as u16;
        for row in 0..=rows {
            for column in 0..=columns {
                let (p, n, uv) = at(f32::from(column) / f32::from(columns), f32::from(row) / f32::from(rows));
                self.positions.push((p / 1000.0).to_array());
                self.normals.push(n.normalize().to_array());
                self.uvs.push(uv.to_array());
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = first + row * (columns + 1) + column;
                let [b, c, d] = [a + 1, a + columns + 2, a + columns + 1];
                self.triangle([a, b, c]);
                self.triangle([a, c, d]);
            }
        }
    }

    /// Adds a surface of `columns` by `rows` cells through the points `at`, mm. Its normals are
    /// computed by finite differences and point away from `inside` of each point.
    pub fn surface(&mut self, columns: u16, rows: u16, inside: impl Fn(Vec3) -> Vec3, at: impl Fn(f32, f32) -> Vec3) {
        const STEP: f32 = 1e-3;
        self.grid(columns, rows, |s, t| {
            let p = at(s, t);
            let low = |v: f32| (v - STEP).max(0.0);
            let high = |v: f32| (v + STEP).min(1.0);
            let normal = (at(high(s), t) - at(low(s), t)).cross(at(s, high(t)) - at(s, low(t)));
            let out = p - inside(p);
            // A pole has no direction of its own.
            let normal = normal.try_normalize().unwrap_or(out);
            (p, if normal.dot(out) < 0.0 { -normal } else { normal }, Vec2::ZERO)
        });
    }

    fn triangle(&mut self, mut corners: [u16; 3]) {
        let [a, b, c] = corners.map(|i| Vec3::from(self.positions[usize::from(i)]));
        let front = (b - a).cross(c - a);
        if front.length() < 1e-14 {
            return; // the pole of a surface of revolution
        }
        let out: Vec3 = corners.iter().map(|&i| Vec3::from(self.normals[usize::from(i)])).sum();
        if front.dot(out) < 0.0 {
            corners.swap(1, 2);
        }
        self.indices.extend(corners);
    }

    pub fn bounds(&self) -> (Vec3, Vec3) {
        let points = || self.positions.iter().map(|&p| Vec3::from(p));
        (points().reduce(Vec3::min).unwrap_or_default(), points().reduce(Vec3::max).unwrap_or_default())
    }
}
