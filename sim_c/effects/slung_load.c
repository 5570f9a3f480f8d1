/* Load on a thread: a pendulum where it hangs free, a weight that is dragged over the ground where the thread is longer
 * than the attachment a is high (h < L, h over the ground at the load).
 *
 * Hanging, a spherical pendulum: load at horizontal position l (states l, dl/dt), with r = a - l, and h = sqrt(L^2 - r^2) below
 * the attachment: l'' = (g + l_z'') r/h + d, with the air's brake d = -2 z sqrt(g/L) (l' - v_wind), and force of the thread on the
 * vehicle -m_l (g + l_z'') (r/h, 1) at the attachment. From l_z = a_z - h follows, twice derived,
 * l_z'' (1 + r^2/h^2) = a_z'' + (r'^2 + r.(a'' - d) - g r^2/h + (r.r')^2/h^2)/h, where a'' = (a' - u)/TAUT_S and the states u follow
 * the attachment's velocity a' within TAUT_S.
 * On the ground, rho = |a - l| horizontally, s = sqrt(rho^2 + h^2): the thread only pulls, T = m_l g e / (c L) with the
 * extension e = s - (1 - c) L, so that it has its length L under the load's weight. The load stays where it is up to the pull
 * at which friction gives way (Coulomb, quasi-static), T rho/s = mu (m_l g - T h/s), hence T = mu m_l g s / (rho + mu h); it
 * then follows within FOLLOWS_S. As h grows to L both agree: no more than the weight, straight down. Where the height is
 * unknown the load hangs free, and where the ground is said to be lower it hangs lower.
 */
#include "effect.h"

#include "../world/ground.h"

#define GIVE 0.01       /* c: a thread's extension under the load's weight, over its length */
#define LEAST_BELOW 0.1 /* square of the cosine of the widest swing */
#define MOST_G 5.0      /* largest upward acceleration of the load, in g: what comes to more would swing over the top */
#define TAUT_S 0.005    /* time in which a taut thread takes the load along */
#define FOLLOWS_S 0.02  /* some steps of a recording, so that the load neither lags nor overshoots */

enum { AT = 0, MOVES = 2, TOWED = 4 }; /* states */
enum { MASS, LENGTH, DAMPING, ATTACH_X, ATTACH_Y, FRICTION, START_X, START_Y, BELOW };

/* Attachment, world. */
static void attachment(const sample_t *s, const vd *p, vd a[3]) {
  for (int k = 0; k < 3; k++) a[k] = s->p[k] + (s->r[3 * k] * p[ATTACH_X] + s->r[3 * k + 1] * p[ATTACH_Y]);
}

static void begin(const sample_t *s, const vd *p, vd *x) {
  vd a[3];
  attachment(s, p, a);
  for (int k = 0; k < 2; k++) {
    x[AT + k] = a[k] + p[START_X + k];
    x[MOVES + k] = s->v[k];
  }
  for (int k = 0; k < 3; k++) x[TOWED + k] = s->v[k];
}

/* Horizontal acceleration of a hanging load whose attachment is accelerated by `tow`, and the force of its thread, world; a
 * thread that would have to push is slack. */
static void hang(const sample_t *s, const vd *p, const vd *x, const vd a[3], const vd tow[3], vd swing[2], vd force[3]) {
  vd damping = 2.0 * p[DAMPING] * lane_sqrt(s->gravity / p[LENGTH]), square = p[LENGTH] * p[LENGTH];
  vd away[2] = {a[0] - x[AT], a[1] - x[AT + 1]}, air[2], out2 = away[0] * away[0] + away[1] * away[1];
  vd h = lane_sqrt(lane_max(square - out2, LEAST_BELOW * square)), opens = all_lanes(0.0), throws = all_lanes(0.0);
  for (int k = 0; k < 2; k++) {
    vd apart = s->v[k] - x[MOVES + k];
    air[k] = damping * (s->wind[k] - x[MOVES + k]);
    opens += away[k] * apart;
    throws += apart * apart + away[k] * (tow[k] - air[k]);
  }
  vd lift = (tow[2] + (throws - s->gravity * out2 / h + opens * opens / (h * h)) / h) / (1.0 + out2 / (h * h));
  vd bears = s->gravity + lane_min(lane_max(lift, -s->gravity), MOST_G * s->gravity);
  for (int k = 0; k < 2; k++) {
    vd pull = bears / h * away[k];
    swing[k] = pull + air[k];
    force[k] = -p[MASS] * pull;
  }
  force[2] = -p[MASS] * bears;
}

/* Velocity of a load that lies on the ground, and the force of its thread, world. */
static void drag(const sample_t *s, const vd *p, const vd *x, const vd a[3], vd height, vd slide[2], vd force[3]) {
  vd away[2] = {a[0] - x[AT], a[1] - x[AT + 1]}, h = lane_max(height, all_lanes(0.0)), least = 1e-9 * p[LENGTH];
  vd rho = lane_sqrt(away[0] * away[0] + away[1] * away[1]), reach = lane_max(lane_sqrt(rho * rho + h * h), least);
  vd extension = lane_max(reach - (1.0 - GIVE) * p[LENGTH], all_lanes(0.0));
  vd yields = GIVE * p[LENGTH] * p[FRICTION] * reach / lane_max(rho + p[FRICTION] * h, least);
  vd pull = p[MASS] * s->gravity / (GIVE * p[LENGTH]) * lane_min(extension, yields) / reach;
  vd follow = lane_max(extension - yields, all_lanes(0.0)) / (FOLLOWS_S * lane_max(rho, least));
  for (int k = 0; k < 2; k++) {
    slide[k] = follow * away[k];
    force[k] = -pull * away[k];
  }
  force[2] = -pull * h;
}

static void apply(const sample_t *s, const vd *p, const vd world[3], wrench_t *add) {
  vd body[3];
  for (int k = 0; k < 3; k++) body[k] = s->r[k] * world[0] + s->r[3 + k] * world[1] + s->r[6 + k] * world[2];
  for (int k = 0; k < 3; k++) add->force[k] += body[k];
  add->moment[0] += p[ATTACH_Y] * body[2];
  add->moment[1] -= p[ATTACH_X] * body[2];
  add->moment[2] += p[ATTACH_X] * body[1] - p[ATTACH_Y] * body[0];
}

static void wrench(const sample_t *s, const vd *p, const vd *x, vd *dx, wrench_t *add) {
  vd a[3], *tow = dx + TOWED, swing[2], slide[2], free_force[3], ground_force[3];
  attachment(s, p, a);
  vd height = a[2] - ground_at(s->map, x[AT], x[AT + 1]).height + p[BELOW];
  for (int k = 0; k < 3; k++) tow[k] = (s->v[k] - x[TOWED + k]) / TAUT_S;
  hang(s, p, x, a, tow, swing, free_force);
  drag(s, p, x, a, height, slide, ground_force);
  vl lies = LT(height, p[LENGTH]);
  for (int k = 0; k < 2; k++) {
    dx[AT + k] = sel(lies, slide[k], x[MOVES + k]);
    dx[MOVES + k] = sel(lies, (slide[k] - x[MOVES + k]) / FOLLOWS_S, swing[k]);
  }
  for (int k = 0; k < 3; k++) free_force[k] = sel(lies, ground_force[k], free_force[k]);
  apply(s, p, free_force, add);
}

EFFECT(slung_load) = {
    .name = "slung_load",
    .title = "load on a thread",
    .equation = "hanging, h = sqrt(L^2 - |a - l|^2): l'' = (g + l_z'')/h (a - l) - 2 z sqrt(g/L)(l' - v_wind), "
                "F = -m_l (g + l_z'')((a - l)/h, 1); "
                "dragged over the ground: T = mu m_l g s / (rho + mu h) along the thread",
    .latex = "\\text{hanging, } h = \\sqrt{L^2 - |a - l|^2} \\\\ "
             "\\ddot l = \\frac{g + \\ddot l_z}{h}\\, (a - l) - 2 z \\sqrt{g/L}\\, (\\dot l - v_\\text{wind}) \\\\ "
             "F = -m_l\\, (g + \\ddot l_z)\\, ((a - l)/h, 1) \\\\ "
             "\\text{dragged over the ground: } T = \\mu\\, m_l\\, g \\frac{s}{\\rho + \\mu h} \\text{ along the thread}",
    .reference = "pendulum dynamics; Coulomb friction",
    .channels = "force_x force_y force_z moment_x moment_y moment_z",
    .kind = GES_WRENCH,
    .n_parameters = 9,
    .n_states = 7,
    .parameters =
        {
         {.name = "mass_kg", .unit = "kg", .role = GES_AMPLITUDE, .value = 0.1, .neutral = 0, .low = 0, .high = 20,
          .doc = "mass of the load"},
         {.name = "length_m", .unit = "m", .role = GES_SHAPE, .value = 0.6, .neutral = NAN, .low = 0.05, .high = 20,
          .doc = "length of the thread", .fitted = 1, .reach = 0.03, .reach_over = "length_m"},
         {.name = "damping", .unit = "1", .role = GES_SWITCH, .value = 0.02, .neutral = NAN, .low = 0, .high = 1,
          .doc = "damping ratio of the swing, by the air"},
         {.name = "attach_x_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "attachment, forward"},
         {.name = "attach_y_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -1, .high = 1,
          .doc = "attachment, left"},
         {.name = "friction", .unit = "1", .role = GES_SWITCH, .value = 0.5, .neutral = NAN, .low = 0, .high = 2,
          .doc = "friction of the load on the ground"},
         {.name = "start_x_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -20, .high = 20,
          .doc = "load at first, from below the attachment, world x"},
         {.name = "start_y_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = -20, .high = 20,
          .doc = "load at first, from below the attachment, world y"},
         {.name = "below_m", .unit = "m", .role = GES_SHAPE, .value = 0, .neutral = NAN, .low = 0, .high = 20,
          .doc = "ground lower at the load than the terrain says"},
        },
    .about = GES_PHYSICS,
    .feedback = GES_FEEDBACK_LOAD,
    .needs = "height velocity",
    .search =
        {
         {.amplitudes = "mass_kg", .rule = "hanging", .fixed = {{"below_m", 20}}, .axis = "length_m",
          .levels = LEVELS(0.15, 0.159, 0.169, 0.179, 0.189, 0.201, 0.213, 0.226, 0.239, 0.253, 0.269, 0.285, 0.302,
          0.32, 0.339, 0.359, 0.381, 0.404, 0.428, 0.454, 0.481, 0.51, 0.541, 0.573, 0.607, 0.644, 0.682,
          0.723, 0.767, 0.813, 0.862, 0.913, 0.968, 1.2, 1.7, 2.4)},
         {.amplitudes = "mass_kg", .rule = "at_hubs", .fixed = {{"length_m", 0.6}, {"below_m", 20}},
          .axis = "attach_x_m attach_y_m"},
         {.amplitudes = "mass_kg", .rule = "lying", .axis = "length_m", .levels = LEVELS(0.15, 0.2, 0.27, 0.36, 0.5,
          0.7, 1.2, 2.4)},
         {.amplitudes = "mass_kg", .rule = "drawn", .fixed = {{"start_x_m", 0}, {"start_y_m", 0}},
          .axis = "length_m attach_x_m attach_y_m", .levels = LEVELS(0.6, 1.2)},
        },
    .begin = begin,
    .wrench = wrench,
};
