#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>

#include "click_session.h"
#include "geometry/camera.h"
#include "http/server.h"

namespace wagonsight {

// The click page's requests: what is clicked goes to the session, what a click means is asked of
// the image.
//
//   GET  /                      the page
//   GET  /api/state             board, list of images with their number of corners, targets
//   GET  /api/view?image=I      one image's corners, and where the rest of the board is predicted
//   GET  /api/image?image=I     its pixels
//   POST /api/snap   {image, x, y, radius}            the saddle near a click
//   POST /api/edit   {image, revision, corners}       replaces an image's corners
//   POST /api/accept {image, revision}                takes every predicted corner with a saddle
//   POST /api/ball   {image, x, y}                    the ball about a click: outline and centre
//   POST /api/targets {targets}                       replaces the targets
//   POST /api/undo, /api/redo
// Errors are {"error": sentence}; 409: the image was changed by another page since.
class ClickSite : public HttpHandler {
 public:
  // `cameras` by sensor: start values, where they are known.
  ClickSite(ClickSession session, std::map<std::string, Camera> cameras, std::uint16_t port);

  ServerAnswer answer(const ServerRequest& request) override;
  ServerAnswer refuse(int status) override;

 private:
  ServerAnswer page() const;
  ServerAnswer get(const std::string& path, const std::string& query);
  ServerAnswer post(const std::string& path, const Json& asked);
  ServerAnswer state() const;
  ServerAnswer view(std::size_t image);
  ServerAnswer picture(std::size_t image);
  ServerAnswer snap(std::size_t image, const Json& asked);
  ServerAnswer edit(std::size_t image, const Json& asked);
  ServerAnswer accept(std::size_t image, const Json& asked);
  std::set<int> drop_misfits(std::size_t image, const LoadedImage& pixels,
                             std::vector<Corner>& corners) const;
  ServerAnswer ball(std::size_t image, const Json& asked);
  ServerAnswer targets(const Json& asked);
  ServerAnswer step(bool back);
  Json view_json(std::size_t image, const LoadedImage& pixels) const;
  std::optional<Camera> camera_of(std::size_t image) const;

  ClickSession session_;
  std::map<std::string, Camera> cameras_;
  std::uint16_t port_;
  ImageCache cache_;
};

}  // namespace wagonsight
