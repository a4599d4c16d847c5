// The vehicle's side of the state-estimation service for C++17: observer_client.h with ownership and exceptions.
//
// A failure that the loop cannot recover from (a handle of another thread, a broken port) throws observer::Error with the
// library's text. What a loop must expect is returned as a value: nothing to take yet, no reader, no answer in time.
// Programs without exceptions use observer_client.h, which has none.

#ifndef OBSERVER_CLIENT_HPP
#define OBSERVER_CLIENT_HPP

#include "observer_client.h"
#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace observer {

using Measurement = observer_measurement;
using Estimate = observer_estimate;
using Channel = observer_channel;
using Status = observer_status;

/// A failed call: its code, and a text that says what was found, what was needed and what to do.
class Error : public std::runtime_error {
public:
    Error(observer_result code, const std::string &text) : std::runtime_error(text), code_(code) {}

    /// Which failure: OBSERVER_NO_DAEMON, OBSERVER_REFUSED, …
    observer_result code() const noexcept { return code_; }

private:
    observer_result code_;
};

/// The service's answer to a command.
struct Reply {
    /// OBSERVER_OUTCOME_…: whether the command was carried out.
    std::uint32_t outcome;
    /// What the service says.
    std::string text;
    /// The service's status after the command.
    Status status;
};

/// Nanoseconds of CLOCK_MONOTONIC, the clock of every stamp.
inline std::uint64_t now_ns() noexcept { return observer_now_ns(); }

/// How old an estimate is (s): the last one of a service that died stays, whatever its status says.
inline double age_s(const Estimate &estimate) noexcept
{
    return 1e-9 * static_cast<double>(static_cast<std::int64_t>(now_ns() - estimate.publish_stamp_ns));
}

/// A connection to one instance of the service, closed with this value. It moves, but not to another thread: every
/// call, and the destruction, belong to the thread that made it. (Destroyed by another thread it stays open until
/// its own thread ends.)
class Client {
public:
    /// Connects, and opens the requested ports (bits of OBSERVER_PORTS_…); waits up to `patience` for the
    /// service to start. An empty `root_path` is $OBSERVER_ROOT or the user's own. Allocates and asks the system;
    /// publish, take, peek and status do not, but for one allocation of iceoryx2 in publish.
    explicit Client(const std::string &instance = "vehicle", std::uint32_t ports = OBSERVER_PORTS_ALL,
                    std::chrono::duration<double> patience = std::chrono::seconds(5),
                    const std::string &root_path = {})
    {
        const char *root = root_path.empty() ? nullptr : root_path.c_str();
        checked(observer_open(OBSERVER_LAYOUT, root, instance.c_str(), ports, patience.count(), &client_));
    }

    Client(const Client &) = delete;
    Client &operator=(const Client &) = delete;
    Client(Client &&other) noexcept : client_(std::exchange(other.client_, observer_client{})) {}
    Client &operator=(Client &&other) noexcept
    {
        if (this != &other) {
            close();
            client_ = std::exchange(other.client_, observer_client{});
        }
        return *this;
    }
    ~Client() { close(); }

    /// Publishes one measurement; false where no service is connected now. Never blocks.
    bool publish(const Measurement &measurement)
    {
        return checked(observer_publish(client_, &measurement)) == OBSERVER_OK;
    }

    /// The oldest estimate not yet taken. Never blocks.
    std::optional<Estimate> take()
    {
        return held<Estimate>([this](Estimate *place) { return observer_take(client_, place); });
    }

    /// The next estimate, waited for up to `patience`; nothing if none came. Looks every 50 µs, sleeping in between.
    std::optional<Estimate> wait(std::chrono::duration<double> patience)
    {
        return held<Estimate>([&](Estimate *place) {
            const observer_result result = observer_wait(client_, patience.count(), place);
            return result == OBSERVER_TIMED_OUT ? OBSERVER_NOTHING : result;
        });
    }

    /// The newest estimate, taken or not; nothing before the first. Its age is in its stamps. Never blocks.
    std::optional<Estimate> peek()
    {
        return held<Estimate>([this](Estimate *place) { return observer_peek(client_, place); });
    }

    /// The newest status, published a few times a second; nothing before the first. Never blocks.
    std::optional<Status> status()
    {
        return held<Status>([this](Status *place) { return observer_read_status(client_, place); });
    }

    /// Sends a command (OBSERVER_COMMAND_…) and waits for the answer. Not for the loop.
    Reply command(std::uint32_t command, std::chrono::duration<double> patience = std::chrono::seconds(5))
    {
        observer_reply reply;
        char text[OBSERVER_REPLY_TEXT_BYTES];
        checked(observer_command(client_, command, patience.count(), &reply));
        checked(observer_reply_text(&reply, text, sizeof text));
        return Reply{reply.outcome, text, reply.status};
    }

private:
    static observer_result checked(observer_result result)
    {
        if (result < 0)
            throw Error(result, observer_error_text());
        return result;
    }

    template <typename Payload, typename Call> static std::optional<Payload> held(Call call)
    {
        // Filled where it will stay: half a kilobyte is not copied again.
        std::optional<Payload> payload(std::in_place);
        if (checked(call(&*payload)) == OBSERVER_NOTHING)
            payload.reset();
        return payload;
    }

    void close() noexcept
    {
        if (client_.number != 0)
            observer_close(client_);
    }

    observer_client client_{};
};

} // namespace observer

#endif // OBSERVER_CLIENT_HPP
