// A COLMAP model (text or binary) and a light table (light_table.cpp).
//
//   sparse/0/, sparse/, colmap/sparse/0/ or the folder itself: cameras.bin and images.bin, or cameras.txt and images.txt (colmap_model.h)
//   images/<name>, or the folder itself: the photographs; masks/<name>.png or masks/<name without extension>.png: the object
//   lights.csv or lights.json: their lights, in the world of the model
// PNG and JPEG are sRGB, PNG with straight alpha; EXR is linear, premultiplied. lights.json may say otherwise. JPEG without masks show the surroundings.
#include "dataset/colmap_model.h"

#include "interchange/image_file.h"

#include <algorithm>
#include <filesystem>

namespace nacre {
namespace {

struct Place {
    std::string cameras, images; // paths; empty if there is no model
    bool isBinary = false;
};

Place findModel(const DatasetSource& source)
{
    for (const std::string folder : {"sparse/0/", "sparse/", "colmap/sparse/0/", ""})
        for (const std::string form : {".bin", ".txt"}) { // as COLMAP prefers them
            const std::string cameras = source.pathOf(folder + "cameras" + form), images = source.pathOf(folder + "images" + form);
            if (source.fileExists(cameras) && source.fileExists(images)) return {cameras, images, form == ".bin"};
        }
    return {};
}

Result<Camera> cameraOf(const ColmapCamera& from, const std::string& name, std::optional<FileCamera>& file)
{
    if (!from.model)
        return Error{ErrorCode::kUnsupported, name + ": expected a camera model that is a pinhole with OpenCV's lens, found " + inQuotes(from.modelName) +
                                                  "; undistort the images with COLMAP's image_undistorter, or choose OPENCV or FULL_OPENCV"};
    const std::vector<double>& p = from.parameters;
    const bool hasTwo = from.model->lensAt == 4; // focal lengths
    Camera camera;
    camera.width = from.width, camera.height = from.height;
    camera.fx = p[0], camera.fy = p[hasTwo ? 1 : 0];
    camera.cx = p[hasTwo ? 2 : 1], camera.cy = p[hasTwo ? 3 : 2];
    if (const auto wrong = cameraFault(camera)) return Error{ErrorCode::kBadInput, name + ": expected " + wrong->expected + ", found " + wrong->found};
    double k[6], tangential[2];
    setLens(*from.model, p, k, tangential);
    for (const double c : {k[0], k[1], k[2], k[3], k[4], k[5], tangential[0], tangential[1]})
        if (!(std::fabs(c) <= 1e6)) return Error{ErrorCode::kBadInput, name + ": lens distortion " + numberText(c)};
    file = fileCamera(camera, k, tangential);
    return camera;
}

std::string findMask(const DatasetSource& source, const std::string& name)
{
    const std::string stem = std::filesystem::path(name).replace_extension().string();
    for (const std::string& mask : {"masks/" + name + ".png", "masks/" + stem + ".png", "masks/" + name})
        if (source.fileExists(source.pathOf(mask))) return source.pathOf(mask);
    return "";
}

} // namespace

bool isColmap(const DatasetSource& source) { return !findModel(source).cameras.empty(); }

Status loadColmap(const DatasetSource& source, OlatDataset& out)
{
    if (!hasLightTable(source))
        return Error{ErrorCode::kBadInput, inQuotes(source.path) + ": a COLMAP model without lights; write lights.csv with the columns image, light_x, light_y, "
                                                                   "light_z, or for a flash on the camera lights.json with {\"light_rig\": \"camera\"}"};
    const Place place = findModel(source);
    const Result<std::vector<std::byte>> cameras = source.readFile(place.cameras), images = source.readFile(place.images);
    if (!cameras) return cameras.error();
    if (!images) return images.error();
    const Result<ColmapModel> model = (place.isBinary ? readColmapBinary : readColmapText)(*cameras, *images, place.cameras, place.images);
    if (!model) return model.error();

    std::string folder;
    if (!source.list(source.pathOf("images")).empty()) folder = "images";
    std::vector<Photo> photos;
    bool allOpaque = true; // JPEG without masks
    for (const ColmapImage& image : model->images) {
        Photo photo;
        const Result<Camera> camera = cameraOf(model->cameras.at(image.camera), place.cameras + ": camera " + std::to_string(image.camera), photo.file);
        if (!camera) return camera.error();
        photo.camera = *camera;
        photo.camera.worldFromCamera = image.worldFromCamera;
        photo.name = image.name;
        photo.path = findImage(source, folder, image.name, JsonNode(nullptr, nullptr, ""));
        photo.image.maskPath = findMask(source, image.name);
        allOpaque = allOpaque && photo.image.maskPath.empty() && imageKind(photo.path) == ImageKind::kJpeg;
        photos.push_back(std::move(photo));
    }
    out.colorSpace = ColorSpace::kSrgb;
    out.straightPng = true;
    if (Status s = lightPhotos(source, std::move(photos), out); !s) return s;
    for (const OlatSplit& split : out.splits)
        for (const OlatImage& image : split.images) allOpaque = allOpaque && image.maskPath.empty(); // the table may name masks
    out.backgroundInView = allOpaque;
    return ok();
}

} // namespace nacre
