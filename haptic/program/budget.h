/// @file budget.h  palpate precompute --budget: settings picked from what they are predicted to
/// cost.
#ifndef PALPATE_PROGRAM_BUDGET_H
#define PALPATE_PROGRAM_BUDGET_H

#include "haptic/program/program.h"

/// What may be spent; 0: not limited.
typedef struct budget {
    double tick_us; ///< p99 of a whole tick, thread CPU time [us]
    double bytes;   ///< of the compliance blocks
    double error;   ///< relative: estimated error of the force and rounding of the stored rows
} budget;

/// Read "300us", "0.3ms", "200MB", "2%" into `out`, beside what is there.
/// @return 1; 0 when it is none of these or not positive
int budget_parse(const char *text, budget *out);

/// What the pick is the best of, one clause after "the setting with": printed with the pick, in the
/// help and in the README.
#define BUDGET_RULE                                                                                \
    "the most of the stored rows the scene asks for, then (without a budget of time) a servo "     \
    "busy "                                                                                        \
    "for at most half its period, then the least estimated force error (below 0.5 % all count as " \
    "equal, as do two within 2 % of each other; where nothing estimates it, the finest spacing), " \
    "then the field by the servo, the rows' form as asked, and the least time offline"
/// The same where an error is the only budget.
#define BUDGET_RULE_ERROR                                                                          \
    "the most of the stored rows the scene asks for, then a servo busy for at most half its "      \
    "period, then the field by the servo, then the cheapest tick"

/// Pick method, spacing, stored rows, precision and who computes the field, build that model and
/// check it against the budget by measuring it.
/// @param[out] source   the model and the scene it came from, as source_open leaves them
/// @param[out] account  what was picked and why, for --json; a new reference
/// @return PALPATE_OK; _ARGUMENT when nothing fits (the message names the nearest), what building
/// says
pal_status budget_build(const char *scene, const budget *wanted, const common_options *options,
                        source *out, json_t **account, pal_error *error);

/// The account on stdout, for people.
void budget_print(const json_t *account);

#endif
