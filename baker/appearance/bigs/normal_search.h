// Normals of lobes from where images show highlights and where they do not.
//
// A lobe that is narrow has no slope a few widths from its peak, and a splat meets the peak of its highlight in one image of a hundred or in
// none: descent from a normal that is ten degrees off ends at whichever shoulder it meets. But every image in which a splat is *not* bright
// rules out the normals halfway between light and camera. So the probability of each of some hundred normals around the present one is computed
// from all images of the splat. It gets the mean, and a lobe that is wider, and fainter by as much, by how far the images leave the normal open:
// an unseen highlight is then spread over where it may be instead of being invented in one place.
#pragma once

#include "appearance/bigs/bigs_training.h"
#include "appearance/evidence.h"

namespace nacre {

/// Sets normal, sharpness and colour of the lobes of all splats that the views show. The material, sharpness and colour of a lobe whose normal is
/// known, is shared by groups of 128 splats: their medians, or a sharper or duller one that sends back as much light, whichever is likeliest.
/// The same for any number of threads.
void searchNormals(BigsParameters& parameters, std::span<const GaussianGeometry<float>> geometry, std::span<const ViewEvidence> views);

} // namespace nacre
