#pragma once

#include <memory>
#include <string>

#include "status/access.h"
#include "status/health.h"
#include "status/http.h"

namespace wagonsight {

// The unit's web site: a request and the moment's snapshot in, an answer out. No socket, no clock,
// no thread; called by one thread at a time. Allocates: it lives on the web side.
class StatusSite {
 public:
  explicit StatusSite(const AccessRules& rules);
  ~StatusSite();
  StatusSite(const StatusSite&) = delete;
  StatusSite& operator=(const StatusSite&) = delete;

  // Every route of the contract. An answer with `stream` set goes on with what stream_people and
  // stream_state give until the peer leaves.
  HttpAnswer answer(const HttpRequest& request, const StatusInput& input) const;

  // Server-sent events: `people` (the people file's line) some times a second, `state` (health,
  // sensors, occupancy, calibration, pipeline) about once a second and when there is no snapshot.
  std::string stream_people(const StatusInput& input) const;
  std::string stream_state(const StatusInput& input) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// The sentences for what the server refuses before there is a request to answer.
HttpAnswer refusal(int status);

}  // namespace wagonsight
