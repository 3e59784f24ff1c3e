//! Convex hulls of points in a plane.

use glam::DVec2;

/// The convex hull's corners in order (Andrew 1979, the monotone chain).
pub fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        // The other half begins with the last point. A single point has no other half.
        if chain.len() > 1 {
            chain.pop();
        }
        chain
    };
    [half(&mut points.iter().copied()), half(&mut points.iter().rev().copied())].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convex_hull_excludes_inner_points() {
        let points = [(0.0, 0.0), (4.0, 0.0), (2.0, 1.0), (4.0, 3.0), (0.0, 3.0), (2.0, 3.0)].map(DVec2::from);
        let corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)].map(DVec2::from);
        assert_eq!(convex_hull(points.to_vec()), corners);
        assert!(convex_hull(Vec::new()).is_empty());
        assert!(convex_hull(vec![DVec2::ONE]).contains(&DVec2::ONE));
    }
}
