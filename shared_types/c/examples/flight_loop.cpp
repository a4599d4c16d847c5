// A flight loop in C++: publishes a measurement every period, waits for the estimate that holds it, and flies on
// where none comes in time.
//
//     flight_loop [SAMPLES [RATE_HZ [PATIENCE_S]]]      1000 samples at 250 Hz, 0.05 s
//
// The service's root path is $OBSERVER_ROOT or the user's own.

#include "observer_client.hpp"
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thread>

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

// What the sensors and the controller of a vehicle that circles would say now.
static observer::Measurement measured(std::uint64_t sequence)
{
    observer::Measurement sample{};
    sample.sequence = sequence;
    sample.stamp_ns = observer::now_ns();
    sample.valid = OBSERVER_VALID_VELOCITY | OBSERVER_VALID_ANGULAR_VELOCITY | OBSERVER_VALID_FORCE;
    const double t_s = static_cast<double>(sample.stamp_ns) * 1e-9;
    sample.velocity_m_s[0] = std::sin(t_s);
    sample.velocity_m_s[1] = std::cos(t_s);
    sample.angular_velocity_rad_s[2] = 0.1 * std::sin(2.0 * t_s);
    sample.force_n[2] = -19.6;
    return sample;
}

// The estimate that holds a sample, or nothing if it does not come within the patience.
static std::optional<observer::Estimate> answer(observer::Client &client, const observer::Measurement &sample,
                                                Seconds patience)
{
    const auto deadline = Clock::now() + patience;
    for (;;) {
        const Seconds left = deadline - Clock::now();
        const auto estimate = client.wait(std::max(left, Seconds(0)));
        if (!estimate)
            return std::nullopt;
        if (estimate->source_sequence == sample.sequence && estimate->source_stamp_ns == sample.stamp_ns)
            return estimate;
    }
}

static void fly(std::uint64_t samples, double rate_hz, Seconds patience)
{
    observer::Client client("vehicle", OBSERVER_PORTS_PUBLISH | OBSERVER_PORTS_TAKE | OBSERVER_PORTS_STATUS);
    const auto period = std::chrono::duration_cast<Clock::duration>(Seconds(1.0 / rate_hz));
    auto deadline = Clock::now();
    std::uint64_t answered = 0, outages = 0;
    bool silent = false;
    observer::Estimate newest{};
    for (std::uint64_t sequence = 0; sequence < samples; ++sequence) {
        const auto sample = measured(sequence);
        client.publish(sample);
        if (const auto estimate = answer(client, sample, patience)) {
            ++answered;
            newest = *estimate;
            silent = false;
            // The controller goes here: estimate->status says whether the estimate may be used.
        } else if (!silent) {
            // The service is away for a moment: fly on, it comes back by itself.
            silent = true;
            ++outages;
        }
        // What is late stays late: nothing is made up in a burst.
        deadline = std::max(deadline + period, Clock::now());
        std::this_thread::sleep_until(deadline);
    }

    const observer::Reply reply = client.command(OBSERVER_COMMAND_STATUS);
    std::printf("published %llu, answered %llu, newest %llu, outages %llu\n",
                static_cast<unsigned long long>(samples), static_cast<unsigned long long>(answered),
                static_cast<unsigned long long>(newest.source_sequence), static_cast<unsigned long long>(outages));
    std::printf("velocity %.3f %.3f %.3f m/s, unknown force %.2f %.2f %.2f N\n", newest.velocity_m_s[0],
                newest.velocity_m_s[1], newest.velocity_m_s[2], newest.matched_force_n[0], newest.matched_force_n[1],
                newest.matched_force_n[2]);
    std::printf("service: %llu samples used, outcome %u%s%s\n",
                static_cast<unsigned long long>(reply.status.counters.samples_accepted), reply.outcome,
                reply.text.empty() ? "" : ": ", reply.text.c_str());
}

int main(int argc, char **argv)
{
    const std::uint64_t samples = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1000;
    const double rate_hz = argc > 2 ? std::strtod(argv[2], nullptr) : 200.0;
    const double patience_s = argc > 3 ? std::strtod(argv[3], nullptr) : 0.5 / rate_hz;
    if (samples == 0 || !(rate_hz >= 1.0) || !(patience_s >= 0.0)) {
        std::fprintf(stderr, "usage: flight_loop [SAMPLES [RATE_HZ [PATIENCE_S]]]\n");
        return 2;
    }
    try {
        fly(samples, rate_hz, Seconds(patience_s));
    } catch (const std::exception &error) {
        std::fprintf(stderr, "flight_loop: %s\n", error.what());
        return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
