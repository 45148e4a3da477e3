//! Links with the spheres and solids that stand for their geometry.

use super::description::{Collision, Description, Shape};
use super::{Place, UrdfOptions};
use crate::error::{Error, Result};
use crate::robot::fit;
use crate::robot::link::{Link, moved};
use crate::robot::mesh::MeshReader;
use crate::robot::solid::{PlacedSolid, Solid};
use crate::robot::xml::quoted;
use glamx::DPose3;

/// Most links with collision geometry: their pairs are listed.
const MAX_SOLID_LINKS: usize = 500;

/// The links with what stands for them in checks.
pub(super) fn links(
    description: &Description,
    places: &[Place],
    options: &UrdfOptions<'_>,
    meshes: &MeshReader<'_>,
    warnings: &mut Vec<String>,
) -> Result<Vec<Link>> {
    let solid = description.links.iter().filter(|link| !link.collisions.is_empty());
    let n_solid = solid.clone().count();
    if let Some(link) = solid.clone().nth(MAX_SOLID_LINKS) {
        let name = quoted(&link.name);
        return Err(Error::Robot(format!(
            "link {name}: {n_solid} links have collision geometry, at most {MAX_SOLID_LINKS} may"
        )));
    }
    let overshoot = options.overshoot.map_or(fit::OVERSHOOT, f64::from);
    let mut links = Vec::with_capacity(places.len());
    for (link, place) in description.links.iter().zip(places) {
        let mut found = Link {
            name: link.name.clone(),
            body: place.body,
            body_from_link: place.body_from_link,
            body_from_shapes: DPose3::IDENTITY,
            spheres: Vec::new(),
            capsules: Vec::new(),
            overshoot: 0.0,
            solids: Vec::new(),
            is_exact: false,
        };
        let mut leave_out = |reason: String| {
            let message = format!("link {}, {reason}", quoted(&link.name));
            if !options.ignore_missing_meshes {
                return Err(Error::Robot(message));
            }
            warnings.push(format!("{message}: it is left out"));
            Ok(())
        };
        for Collision { link_from_solid, shape } in &link.collisions {
            if options.without_geometry {
                break;
            }
            let read = match shape {
                Shape::Solid(solid) => Ok(solid.clone()),
                Shape::Mesh(mesh) => mesh.read(meshes),
            };
            let body_from_solid = place.body_from_link * *link_from_solid;
            match read {
                Ok(solid) => found.solids.push(PlacedSolid { body_from_solid, solid }),
                Err(reason) => leave_out(reason)?,
            }
        }
        // Spheres serve what moves, and what they are exact for.
        found.is_exact = place.body == 0
            && found.solids.iter().all(|placed| placed.solid.is_convex())
            && found.solids.iter().any(|placed| !matches!(placed.solid, Solid::Ball { .. }));
        let solids = core::mem::take(&mut found.solids);
        for placed in solids {
            let cover = if found.is_exact {
                fit::cover_by_few(&placed.solid)
            } else {
                fit::cover(&placed.solid, overshoot)
            };
            match cover {
                Ok(cover) => {
                    found.spheres.extend(moved(&cover.spheres, &placed.body_from_solid));
                    found.overshoot = found.overshoot.max(cover.overshoot);
                    found.solids.push(placed);
                }
                Err(reason) => leave_out(reason)?,
            }
        }
        links.push(found);
    }
    Ok(links)
}
