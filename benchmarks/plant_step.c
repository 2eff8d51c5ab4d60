/* The full-order plant in C: the same equations, options and constants as hil_bench/plants/hydraulic_cylinder/model, written the
 * way C is written, as the yardstick of benchmarks/plant_step.py. */
#include <math.h>

/* The order of hil_bench.plants.hydraulic_cylinder.model.constants.pack. */
typedef struct {
    double dt, m, per_E_dt, floor;
    double omega_0_squared, two_xi_omega_0;
    double alpha, beta, alpha_negative, beta_negative;
    double a_11, a_12, a_21, a_22;
    double K, P_S, P_T, transition_squared, signed_root;
    double E, C_L, A_A, A_B, V_A0, V_B0, h;
    double F_c, weakening, sigma, log_chi, delta, gain;
    double stop_position, stop_stiffness, stop_damping;
} Plant;

/* Unlike fmin and fmax, these become one instruction without -ffast-math. */
static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

typedef struct { double force_or_flow, secant, tangent; } Slopes;

static inline double orifice_state(double nu, const Plant *p)
{
    if (nu > 0.0) return most(least(nu - p->beta, p->alpha), 0.0);
    return least(most(nu + p->beta_negative, -p->alpha_negative), 0.0);
}

static inline Slopes port(double opening, double pressure, const Plant *p)
{
    if (opening == 0.0) return (Slopes){0.0, 0.0, 0.0};
    double drop = opening > 0.0 ? p->P_S - pressure : pressure - p->P_T;
    double square = drop * drop, total = square + p->transition_squared;
    if (total == 0.0 || (drop < 0.0 && p->signed_root == 0.0)) return (Slopes){0.0, 0.0, 0.0};
    double gain = opening * p->K / sqrt(sqrt(total)), secant = fabs(gain);
    return (Slopes){gain * drop, secant, secant * (1.0 - 0.5 * square / total)};
}

static inline Slopes friction(double v, const Plant *p)
{
    double speed = most(fabs(v), 1e-12);
    double power = exp(p->delta * (log(speed) - p->log_chi));
    double stribeck = p->weakening * exp(-power), level = p->F_c + stribeck;
    double sign = tanh(p->gain * speed);
    double rise = sign < 1.0 ? p->gain * (1.0 - sign * sign) * level : 0.0;
    double sign_secant = sign / speed, secant = sign_secant * level + p->sigma;
    double tangent = rise - sign_secant * stribeck * power * p->delta + p->sigma;
    return (Slopes){v * secant, secant, tangent};
}

static inline double sat(double x, double h) { return least(most(x, -h), h); }

static inline double stop_force(double x, double v, const Plant *p)
{
    if (x > p->stop_position)
        return -most(p->stop_stiffness * (x - p->stop_position) + p->stop_damping * v, 0.0);
    if (x < -p->stop_position)
        return most(p->stop_stiffness * (-p->stop_position - x) - p->stop_damping * v, 0.0);
    return 0.0;
}

void advance_forward_euler(double *state, const Plant *plant, double u, double F_L, long steps)
{
    const Plant c = *plant, *p = &c;
    double x = state[0], v = state[1], P_A = state[2], P_B = state[3], nu = state[4], nu_dot = state[5];
    for (long i = 0; i < steps; i++) {
        double z = orifice_state(nu, p);
        double leak = p->C_L * (P_A - P_B);
        double net_A = port(z, P_A, p).force_or_flow - p->A_A * v - leak;
        double net_B = port(-z, P_B, p).force_or_flow + p->A_B * v + leak;
        double V_A = p->V_A0 + p->A_A * sat(x, p->h), V_B = p->V_B0 - p->A_B * sat(x, p->h);
        double force = P_A * p->A_A - P_B * p->A_B - friction(v, p).force_or_flow - F_L
                     + stop_force(x, v, p);
        double acceleration = p->omega_0_squared * (u - nu) - p->two_xi_omega_0 * nu_dot;
        x += p->dt * v;
        v += p->dt * force / p->m;
        P_A = most(P_A + p->dt * p->E / V_A * net_A, p->floor);
        P_B = most(P_B + p->dt * p->E / V_B * net_B, p->floor);
        nu += p->dt * nu_dot;
        nu_dot += p->dt * acceleration;
    }
    state[0] = x, state[1] = v, state[2] = P_A, state[3] = P_B, state[4] = nu, state[5] = nu_dot;
}

static inline double share(double secant, double tangent, double inertia)
{
    double middle = 0.5 * tangent + 0.125 * secant * secant / inertia;
    return middle > secant ? secant : most(middle, -0.25 * inertia);
}

/* The parts of a step: hil_bench.plants.hydraulic_cylinder.model.parts. The C has no cavities, only the floor. */
enum { PARTS = 64, RATIO = 4 };
static const double TOLERANCE = 1e-5, RATE = 1000.0, KINK = 0.125, TWELFTH = 1.0 / 12.0;

typedef struct { double x, v, P_A, P_B; } Motion;

static inline double stopped(
    double dv, double *resistance, double x, double v, double dt, const Plant *p, double *error)
{
    double travel = dt * (v + 0.5 * dv);
    if (fabs(x + travel) <= p->stop_position) {
        *error += 0.5 * fabs(stop_force(x, v, p)) / *resistance;
        return dv;
    }
    double side = copysign(1.0, x + travel), depth = side * x - p->stop_position;
    double middle = depth > 0.0 ? 0.5 : 1.0;
    double push = p->stop_stiffness * (depth + middle * side * travel)
                + p->stop_damping * side * travel / dt;
    if (push <= 0.0) return dv;
    double free = *resistance;
    *resistance += 0.5 * (middle * p->stop_stiffness * dt + p->stop_damping);
    double lost = side * push / *resistance;
    *error += depth > 0.0 ? fabs(dv - lost) * p->stop_stiffness * dt / (12.0 * free) : 0.5 * fabs(lost);
    return dv - lost;
}

static inline double flow_change(Slopes port, double rise, double area)
{
    double change = port.secant * fabs(rise);
    return change > KINK * fabs(port.force_or_flow) ? change / area : 0.0;
}

static inline Motion try_step(
    Motion y, double nu, double nu_end, double F_L, double dt, double per_E_dt, const Plant *p,
    double *error)
{
    double x = y.x, v = y.v, P_A = y.P_A, P_B = y.P_B, mass = p->m / dt;
    double z = orifice_state(0.5 * (nu + nu_end), p);
    Slopes A = port(z, P_A, p), B = port(-z, P_B, p), f = friction(v, p);
    double leak = p->C_L * (P_A - P_B);
    double net_A = A.force_or_flow - p->A_A * v - leak;
    double net_B = B.force_or_flow + p->A_B * v + leak;
    double middle = sat(x + 0.5 * dt * v, p->h);
    double C_A = (p->V_A0 + p->A_A * middle) * per_E_dt;
    double C_B = (p->V_B0 - p->A_B * middle) * per_E_dt;

    double f_share = share(f.secant, f.tangent, mass), inertia = mass + f_share;
    double strength = p->F_c + p->weakening;
    int is_held = strength * p->gain > mass && strength > mass * fabs(v);
    double lag = is_held ? 0.0 : TWELFTH / mass, half = 0.5 + lag * p->sigma;
    double c = 0.5 * p->C_L;
    double a = C_A + c + share(A.secant, A.tangent, C_A) - lag * p->A_A * p->A_A;
    double b = C_B + c + share(B.secant, B.tangent, C_B) - lag * p->A_B * p->A_B;
    c -= lag * p->A_A * p->A_B;
    double per_det = 1.0 / (a * b - c * c);
    double dP_A = (b * net_A + c * net_B) * per_det;
    double dP_B = (c * net_A + a * net_B) * per_det;
    double fall_A = half * (b * p->A_A - c * p->A_B) * per_det;
    double fall_B = half * (c * p->A_A - a * p->A_B) * per_det;

    double force = P_A * p->A_A - P_B * p->A_B - f.force_or_flow - F_L;
    double resistance = inertia + (half - 0.5) * p->sigma
                      + (half - TWELFTH / half) * (p->A_A * fall_A - p->A_B * fall_B);
    double dv = (force + half * (p->A_A * dP_A - p->A_B * dP_B)) / resistance;
    *error = 0.0;
    dv = stopped(dv, &resistance, x, v, dt, p, error);
    if (f.secant <= mass) {
        Slopes end = friction(v + dv, p);
        double rise = end.force_or_flow - f.force_or_flow;
        double bend = (end.tangent - f.tangent) * dv * TWELFTH;
        double excess = 0.5 * rise - bend - f_share * dv;
        double unexplained = 0.25 * fabs(rise - 0.5 * (f.tangent + end.tangent) * dv);
        *error += (unexplained + fabs(bend)) / resistance;
        dv -= excess / (resistance - f_share + most(0.5 * end.tangent, 0.0));
    } else {
        *error += 0.25 * fabs(dv);
    }
    double rise_A = most(dP_A - fall_A * dv, p->floor - P_A);
    double rise_B = most(dP_B - fall_B * dv, p->floor - P_B);
    double flows = flow_change(A, rise_A, p->A_A) + flow_change(B, rise_B, p->A_B);
    double bend = fabs(z - 0.5 * (orifice_state(nu, p) + orifice_state(nu_end, p)));
    *error += RATE * TWELFTH * 0.5 * dt * flows;
    *error += RATE * dt * bend * p->K * sqrt(fabs(p->P_S - p->P_T)) / p->A_A;
    double swing = lag * (p->A_A * rise_A - p->A_B * rise_B);
    return (Motion){x + dt * (v + half * dv - swing), v + dv, P_A + rise_A, P_B + rise_B};
}

void advance_implicit_midpoint(double *state, const Plant *plant, double u, double F_L, long steps)
{
    const Plant constants = *plant, *p = &constants;
    Motion y = {state[0], state[1], state[2], state[3]};
    double nu = state[4], nu_dot = state[5];
    for (long i = 0; i < steps; i++) {
        double off = nu - u, before = nu;
        nu = u + p->a_11 * off + p->a_12 * nu_dot;
        nu_dot = p->a_21 * off + p->a_22 * nu_dot;
        for (int done = 0, size = PARTS; done < PARTS;) {
            double share = (double)size / PARTS, error;
            double from = (double)done / PARTS, to = (double)(done + size) / PARTS;
            Motion moved = try_step(y, (1.0 - from) * before + from * nu, (1.0 - to) * before + to * nu,
                                    F_L, p->dt * share, p->per_E_dt / share, p, &error);
            if (error > TOLERANCE && size > 1) {
                size /= RATIO;
                continue;
            }
            y = moved;
            done += size;
            while (size < PARTS && done % (RATIO * size) == 0) size *= RATIO;
        }
    }
    state[0] = y.x, state[1] = y.v, state[2] = y.P_A, state[3] = y.P_B, state[4] = nu, state[5] = nu_dot;
}
