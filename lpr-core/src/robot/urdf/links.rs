//! Links with the spheres and solids that stand for their geometry.

use super::description::{Collision, Description, Shape};
use super::{Place, UrdfOptions};
use crate::error::{Error, Result};
use crate::in_order::map_in_order;
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
    let mut leave_out = |link: &str, reason: String| {
        let message = format!("link {}, {reason}", quoted(link));
        if !options.ignore_missing_meshes {
            return Err(Error::Robot(message));
        }
        warnings.push(format!("{message}: it is left out"));
        Ok(())
    };
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
                Err(reason) => leave_out(&link.name, reason)?,
            }
        }
        // Spheres serve what moves, and what they are exact for.
        found.is_exact = place.body == 0
            && found.solids.iter().all(|placed| placed.solid.is_convex())
            && found.solids.iter().any(|placed| !matches!(placed.solid, Solid::Ball { .. }));
        links.push(found);
    }
    cover(&mut links, overshoot, &mut leave_out)?;
    Ok(links)
}

/// The spheres of the links.
fn cover(
    links: &mut [Link],
    overshoot: f64,
    leave_out: &mut impl FnMut(&str, String) -> Result<()>,
) -> Result<()> {
    let solids: Vec<(&PlacedSolid, bool)> = links
        .iter()
        .flat_map(|link| link.solids.iter().map(|placed| (placed, link.is_exact)))
        .collect();
    let covers = map_in_order(solids.len(), |i| {
        let (placed, is_exact) = solids[i];
        if is_exact {
            fit::cover_by_few(&placed.solid)
        } else {
            fit::cover(&placed.solid, overshoot)
        }
    });
    let mut covers = covers.into_iter();
    for link in links {
        for placed in core::mem::take(&mut link.solids) {
            match covers.next().expect("one for each solid") {
                Ok(cover) => {
                    link.spheres.extend(moved(&cover.spheres, &placed.body_from_solid));
                    link.overshoot = link.overshoot.max(cover.overshoot);
                    link.solids.push(placed);
                }
                Err(reason) => leave_out(&link.name, reason)?,
            }
        }
    }
    Ok(())
}
