/// @file passivity.h  Passivity observer of one tool: the work at the port of its device (private).
///
/// The force of a tick is held until the next (zero-order hold), so the work that the engine does
/// on the device in between is exactly
///     W_n = F_n . (x_(n+1) - x_n)
/// with the positions read at the ticks, however the device moved between them (Stramigioli,
/// Secchi, van der Schaft and Fantuzzi, IEEE Trans. Robotics 21(4), 2005; the observer: Hannaford
/// and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). From rest without contact a passive
/// engine has sum W <= 0 at all times; what a period of sampling adds is K |x_(n+1) - x_n|^2 / 2
/// per tick of a spring K, the term K T / 2 of Colgate and Schenkel (J. Robotic Systems 14(1),
/// 1997). Plain data, no allocation, lock or log. Thread: the servo's.
#ifndef PALPATE_HAPTIC_PASSIVITY_H
#define PALPATE_HAPTIC_PASSIVITY_H

typedef struct pal_passivity {
    double position[3]; ///< last [m]
    double force[3];    ///< held since then, on the device [N]
    int started;
    double given; ///< work done on the device, sum of the positive W [J]
    double taken; ///< work done by the device, minus the sum of the negative W [J]
    double worst; ///< largest given - taken there has been; a passive engine: 0 [J]
    double mark;  ///< given - taken at the last mark [J]
} pal_passivity;

/// A tick: position as read, force as given out. Values that are not finite end the period without
/// work. @return W of the period that has ended [J]
double pal_passivity_tick(pal_passivity *p, const double position[3], const double force[3]);

/// Energy given since the last mark (or the start), taken subtracted; sets the mark. Called once a
/// cycle: what a cycle returned [J].
double pal_passivity_mark(pal_passivity *p);

#endif
