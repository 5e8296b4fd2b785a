/// @file soak.h  One episode of the soak: tools that move as hands do, devices that lie, and what
/// must hold in every tick whatever they do.
#ifndef PALPATE_TESTS_SOAK_H
#define PALPATE_TESTS_SOAK_H

#include <stdint.h>

#include <palpate/session.h>

// ---- Random numbers: SplitMix64 (Steele, Lea and Flood 2014), one seed per episode
// ----------------
typedef struct soak_rng {
    uint64_t state;
} soak_rng;
double soak_uniform(soak_rng *r, double low, double high);
int soak_chance(soak_rng *r, double probability);
int64_t soak_below(soak_rng *r, int64_t n); ///< 0 to n - 1

// ---- A hand (soak_hand.c)
// --------------------------------------------------------------------------
typedef enum soak_fault {
    SOAK_NONE,
    SOAK_NOT_A_NUMBER,
    SOAK_REFUSED,
    SOAK_FROZEN,
    SOAK_BACKWARDS,
    SOAK_TELEPORT,
    SOAK_REFUSED_WRITE,
    SOAK_MISSED, ///< engine alone: periods without a tick
    SOAK_FAULTS
} soak_fault;

struct soak_episode;

/// A tool's motion: presses that come and go, sliding, circling, tremor, a turning wrist; and
/// faults.
typedef struct soak_hand {
    struct soak_episode *episode;
    int index;
    double origin[3], normal[3], tangent[3], side[3]; ///< where it works on the body
    double clearance, depth, press_rate, press_phase; ///< [m], [m], [Hz], [rad]
    double slide[2], slide_rate[2], slide_phase[2];
    double tremor, tremor_rate;
    double turn_axis[3], turn, turn_rate;
    int grasps, retraces;
    double fault_rate; ///< probability of a fault beginning in a tick
    soak_fault fault;
    int64_t fault_left; ///< ticks
    double jump[3];
    int64_t stamp; ///< of the last read that was usable
    int unusable;  ///< bad reads in a row, this one included
    int simulated; ///< the pose comes from `inner` instead
    pal_device inner;
    soak_rng rng;
    uint64_t refused; ///< reads and writes
    uint64_t injected[SOAK_FAULTS];
} soak_hand;

/// Choose a motion over the touchable surface of the episode's model.
void soak_hand_init(soak_hand *h, struct soak_episode *e, int index);
/// The pose of tick n (time_ns = n periods); may lie. @return _DEVICE when it refuses
pal_status soak_hand_read(soak_hand *h, int64_t time_ns, pal_tool_state *state);
/// The force of that tick; may refuse.
pal_status soak_hand_write(soak_hand *h, int64_t time_ns, const pal_tool_force *force);

// ---- What must hold (soak_check.c)
// ------------------------------------------------------------------
typedef struct soak_track {
    double force[3], position[3], torque[3], orientation[4]; ///< of the tick before
    int64_t latched_for;
    uint64_t fault[32]; ///< ticks with each bit
} soak_track;

/// Work done on the body since all tools were last free of it, by the trapezoidal rule.
typedef struct soak_energy {
    int begun;           ///< a tick before exists
    int judged;          ///< 0: something happened in this excursion that energy says nothing about
    double work, stored; ///< now and the largest [J]
    double blur;         ///< what the rule cannot tell: sum of |dF| |dx| / 4 over the ticks [J]
    double worst;        ///< of all excursions: the most negative end / the largest stored
    double beyond;       ///< of all excursions: the farthest an end lay below -blur [J]
    double given, taken; ///< sums of the ends below and above zero [J]
    uint64_t excursions; ///< of which energy says something
    double largest;      ///< force [N] seen
} soak_energy;

enum { SOAK_TOOLS = 4 };

typedef struct soak_episode {
    uint64_t seed;
    soak_rng rng;
    const pal_model *model;
    const char *model_name;
    double size;         ///< of the body [m]
    int retraces;        ///< one tool whose path is retraced: energy is judged
    pal_session_def def; ///< tools and engine definition as asked for
    pal_tool_def tool[SOAK_TOOLS];
    pal_engine_def effective;
    double dead_after; ///< ticks after which a latched force must be zero, per tool's slew
    int64_t ticks;
    int by_session; ///< 1: a whole session in freewheel; 0: the engine alone
    pal_session *session;
    soak_hand hand[SOAK_TOOLS];
    soak_track track[SOAK_TOOLS];
    pal_tool_state in[SOAK_TOOLS]; ///< of this tick, as the hand gave them
    int bad[SOAK_TOOLS];           ///< 1: this tick's input is a lie or a refusal
    soak_energy energy;
    uint64_t frames;
    char failure[400]; ///< "" while all holds
} soak_episode;

/// A violation: kept when it is the first, ends the episode.
void soak_fail(soak_episode *e, const char *format, ...) __attribute__((format(printf, 2, 3)));
/// One tool's output of tick n.
void soak_check_force(soak_episode *e, int tool, int64_t n, const pal_tool_force *f);
/// After all tools' outputs of tick n.
void soak_check_tick(soak_episode *e, int64_t n, const pal_tool_force out[]);
/// A published frame.
void soak_check_frame(soak_episode *e, const pal_frame *frame);
/// Totals at the end. @param counts  the engine's
void soak_check_counts(soak_episode *e, const pal_engine_counts *counts);

#endif
