/* The step, once for every number of rotors (GES_ROTORS) and lane width (GES_W): fly flights, or replay recorded samples.
 *
 * A step: sample of the state -> ground effect -> sensors and firmware (every control_every steps) -> drive ->
 * remaining effects, contact -> record -> integrate. Semi-implicit Euler advances velocities first and positions with
 * the new velocities; Runge-Kutta 4 holds the command through its four stages.
 */
#include "kernel.h"

#include <math.h>

#include "../body/contact.h"
#include "../body/model.h"
#include "../core/random.h"
#define FIRMWARE_LANES GES_W
#define FIRMWARE_ROTORS GES_ROTORS
#include "../firmware/firmware.h"
#include "columns.h"

#define X(name) extern const effect_t PER_UNIT(effect_##name);
#include "../effects/effects.def"
#undef X

static const effect_t *const effect_table[] = {
#define X(name) &PER_UNIT(effect_##name),
#include "../effects/effects.def"
#undef X
};

enum { GYRO, RANGE, TELEMETRY, ACCELERATION, NAVIGATION, N_STREAMS };

typedef struct {
  vd gyro, acc, range, range_max, rpm, current, per_torque, idle, position, velocity;
} noise_t;

typedef struct {
  vd agl_ref, cruise, track_start, descent, descent_period, descent_duration, preview;
  int any_preview;
  const double *inputs[GES_W];
  int n_inputs[GES_W];
  vd inputs_dt, inputs_start;
} task_t;

/* Where lanes are in their input tables: the row, numbers from there to the next one, and how far on the way to it. */
typedef struct {
  const double *row[GES_W];
  int64_t next[GES_W];
  double share[GES_W];
  int alike; /* whether all lanes read the same */
} place_t;

/* What the firmware and the drive report, as recorded. */
typedef struct {
  vd thrust_command, estimate, shadow, p_ref[3], v_ref[3], yaw_ref, battery;
} report_t;

typedef struct {
  const plan_t *plan;
  vehicle_t body;
  active_t active;
  ground_lanes_t ground;
  noise_t noise;
  task_t task;
  place_t place; /* of what is replayed */
  fw_config config;
  fw_state memory;
  stream_t stream[N_STREAMS];
  vd dt, y[Y_MAX], dy[Y_MAX];
  int n_y;
  sample_t sample;
  reading_t reading;
  report_t report;
  vd force[3], acc_error[3]; /* force on the body without gravity; errors of the accelerometer */
} lanes_t;

/* ---- setting up ------------------------------------------------------------------------------------------- */

static void add_active(active_t *a, int id, const ges_effects *const *effects) {
  const effect_t *e = effect_table[id];
  int j = a->n++;
  a->effect[j] = e;
  a->first_state[j] = a->n_states;
  a->n_states += e->n_states;
  if (has_rates(e)) a->any_rates = 1;
  for (int i = 0; i < GES_W; i++)
    for (int m = 0; m < effects[i]->n; m++)
      if (effects[i]->id[m] == id)
        for (int k = 0; k < e->n_parameters; k++) set_lane(&a->p[j][k], i, effects[i]->value[m][k]);
  if (e->thrust_gain) {
    a->thrust_gain = e->thrust_gain;
    a->thrust_gain_p = a->p[j];
  }
  if (e->blow) a->wants_agl = 1;
}

static void load_law(law_t *law, const plan_t *plan, const ges_effects *const *effects) {
  law->n = plan->n_terms;
  law->term = plan->term;
  for (int j = 0; j < law->n; j++) {
    for (int i = 0; i < GES_W; i++) set_lane(&law->coefficient[j], i, effects[i]->coefficient[j]);
    for (int k = 0; k < N_GROUPS; k++) law->uses[k] |= law->term[j].power[k] + law->term[j].magnitude[k] > 0;
  }
}

static void load_active(active_t *a, const plan_t *plan, const ges_effects *const *effects) {
  memset(a, 0, sizeof *a);
  for (int j = 0; j < plan->n_effects; j++) add_active(a, plan->effect[j], effects);
  load_law(&a->law, plan, effects);
}

static void load_noise(noise_t *n, const double *const *p) {
  n->gyro = column(p, P_gyro_noise_rad_s);
  n->acc = column(p, P_acc_noise_m_s2);
  n->range = column(p, P_range_noise_m);
  n->range_max = column(p, P_range_max_m);
  n->rpm = column(p, P_rpm_noise_rad_s);
  n->current = column(p, P_current_noise_A);
  n->per_torque = column(p, P_current_per_torque_A_Nm);
  n->idle = column(p, P_current_idle_A);
  n->position = column(p, P_position_noise_m);
  n->velocity = column(p, P_velocity_noise_m_s);
}

static void load_task(task_t *t, const double *const *p, ges_flight *const *flights) {
  t->agl_ref = column(p, P_agl_ref_m);
  t->cruise = column(p, P_cruise_m_s);
  t->track_start = column(p, P_track_start_m);
  t->descent = column(p, P_descent_m);
  t->descent_period = column(p, P_descent_period_s);
  t->descent_duration = column(p, P_descent_duration_s);
  t->preview = column(p, P_preview_s);
  t->any_preview = any(GT(t->preview, all_lanes(0.0)));
  t->inputs_dt = column(p, P_inputs_dt_s);
  t->inputs_start = column(p, P_inputs_start_s);
  for (int i = 0; i < GES_W; i++) {
    t->inputs[i] = flights[i]->inputs;
    t->n_inputs[i] = flights[i]->n_inputs;
  }
}

/* What rotor k of lane i makes per its thrust: force along z, moments x, y, z. */
static void thrust_effect(const vehicle_t *b, int i, int k, float effect[4][FIRMWARE_MAX_ROTORS]) {
  double x = lane(b->hub[0][k], i), y = lane(b->hub[1][k], i);
  double yaw = -lane(b->spin[k], i) * lane(b->torque_coefficient, i) / lane(b->thrust_coefficient, i);
#if GES_GENERAL
  double z = lane(b->hub[2][k], i), ax = lane(b->axis[k][0], i), ay = lane(b->axis[k][1], i), az = lane(b->axis[k][2], i);
  yaw *= lane(b->torque_share[k], i) / fmax(lane(b->thrust_share[k], i), 1e-9);
  effect[0][k] = (float)az;
  effect[1][k] = (float)(y * az - z * ay + yaw * ax);
  effect[2][k] = (float)(z * ax - x * az + yaw * ay);
  effect[3][k] = (float)(x * ay - y * ax + yaw * az);
#else
  effect[0][k] = 1.0f;
  effect[1][k] = (float)y;
  effect[2][k] = -(float)x;
  effect[3][k] = (float)yaw;
#endif
}

static int load_mixer(fw_config *c, const vehicle_t *b, int i) {
  float effect[4][FIRMWARE_MAX_ROTORS], mixer[FIRMWARE_MAX_ROTORS][4];
  int rotors = ROTORS_OF(b);
  for (int k = 0; k < rotors; k++) thrust_effect(b, i, k, effect);
  int good = mixer_make(rotors, effect, mixer);
  for (int j = 0; good && j < rotors; j++)
    for (int k = 0; k < 4; k++) memcpy((char *)&c->mixer[j][k] + 4 * i, &mixer[j][k], 4);
  return good;
}

static vf setting(const double *const *p, int index) { return to_float(column(p, index)); }

static void load_gains(fw_config *c, const double *const *p) {
  c->altitude_kp = setting(p, P_altitude_kp);
  c->altitude_ki = setting(p, P_altitude_ki);
  c->altitude_kd = setting(p, P_altitude_kd);
  c->altitude_filter = setting(p, P_altitude_filter_s);
  c->altitude_integral = setting(p, P_altitude_integral_m_s2);
  c->position_kp = setting(p, P_position_kp);
  c->velocity_kp = setting(p, P_velocity_kp);
  c->attitude_kp = setting(p, P_attitude_kp);
  c->attitude_ki = setting(p, P_attitude_ki);
  c->attitude_kd = setting(p, P_attitude_kd);
  c->yaw_kp = setting(p, P_yaw_kp);
  c->yaw_ki = setting(p, P_yaw_ki);
  c->yaw_kd = setting(p, P_yaw_kd);
  vd sine, cosine;
  lane_sin_cos(column(p, P_tilt_max_rad), &sine, &cosine);
  c->tangent_max = to_float(sine / cosine);
}

static void load_feedforward(fw_config *c, const double *const *p) {
  c->mode = setting(p, P_mode);
  c->mapping = setting(p, P_mapping);
  c->per_rotor = setting(p, P_per_rotor);
  c->bias = setting(p, P_bias);
  c->pulse = setting(p, P_pulse);
  c->pulse_start = setting(p, P_pulse_start_s);
  c->pulse_end = to_float(column(p, P_pulse_start_s) + column(p, P_pulse_duration_s));
  c->lead = setting(p, P_lead_s);
  c->cutover = setting(p, P_cutover_m);
  c->trust_band = setting(p, P_trust_band);
  c->overprediction_clamp = setting(p, P_overprediction_clamp);
  c->range_to_rotor = setting(p, P_range_to_rotor_m);
  c->height_from_position = WHEN(setting(p, P_altitude_source) > 0.5f);
  c->network_runs = ge_ff_runs_network(c->mode) | WHEN(setting(p, P_shadow) > 0.5f);
}

/* What the firmware believes of the vehicle. */
static int load_belief(fw_config *c, const plan_t *plan, const vehicle_t *b, const double *const *p) {
  vd mass = column(p, P_fw_mass_kg), thrust = column(p, P_fw_thrust_coefficient_N_s2);
  c->mass = to_float(sel(GT(mass, all_lanes(0.0)), mass, b->mass));
  c->thrust_coefficient = to_float(sel(GT(thrust, all_lanes(0.0)), thrust, b->thrust_coefficient));
  for (int k = 0; k < 3; k++) c->inertia[k] = to_float(b->inertia[k] * column(p, P_fw_inertia_scale));
  c->thrust_curve = to_float(column(p, P_fw_thrust_curve));
  c->gravity = to_float(b->gravity);
  c->speed_max = to_float(b->speed_max);
  c->rotor_radius = to_float(b->radius[0]);
  c->rotors = ROTORS_OF(b);
  c->allocation = plan->allocation;
  for (int i = 0; i < GES_W; i++)
    if (!load_mixer(c, b, i) && plan->control == CONTROL_firmware) return 0;
  return 1;
}

static void seed_streams(stream_t *stream, const double *const *p) {
  for (int k = 0; k < N_STREAMS; k++)
    for (int i = 0; i < GES_W; i++) seed_lane(&stream[k], i, (uint64_t)p[i][P_seed], (uint64_t)k + 1);
}

/* Held before the first and after the last row. */
static void find_place(const task_t *task, int width, vd t, place_t *at) {
  vd row = (t - task->inputs_start) / task->inputs_dt + 1e-9;
  at->alike = 1;
  for (int i = 0; i < GES_W; i++) {
    int last = task->n_inputs[i] - 1;
    double bounded_row = bounded(lane(row, i), (double)last);
    int j = (int)bounded_row < last ? (int)bounded_row : last;
    at->row[i] = task->inputs[i] + (int64_t)j * width;
    at->next[i] = j == last ? 0 : width;
    at->share[i] = bounded_row - j;
    at->alike &= at->row[i] == at->row[0] && at->share[i] == at->share[0];
  }
}

static double input_at(const place_t *at, int i, int k, int hold) {
  const double *a = at->row[i] + k;
  return hold || !at->next[i] ? a[0] : a[0] + at->share[i] * (a[at->next[i]] - a[0]);
}

static vd input(const place_t *at, int k, int hold) {
  if (at->alike) return all_lanes(input_at(at, 0, k, hold));
  vd value = all_lanes(0.0);
  for (int i = 0; i < GES_W; i++) set_lane(&value, i, input_at(at, i, k, hold));
  return value;
}

static void start_trimmed(lanes_t *l) {
  const vehicle_t *b = &l->body;
  vd zero = all_lanes(0.0), x = l->task.track_start, y = zero, vx = l->task.cruise, up = l->task.agl_ref;
  if (l->plan->references) {
    place_t first;
    find_place(&l->task, GES_REFERENCE_COLUMNS, zero, &first);
    x = input(&first, 0, 1);
    y = input(&first, 1, 1);
    up = input(&first, 2, 1);
    vx = input(&first, 3, 1);
  }
  ground_move(&l->ground, x);
  vf in_world = pick(l->config.height_from_position, number(0.0f), number(1.0f));
  vd ground = ground_at(&l->ground, x, y).height * to_double(in_world);
  #if GES_GENERAL
  vd per_square = all_lanes(0.0);
  for (int i = 0; i < b->rotors; i++) per_square += b->thrust_coefficient * (b->thrust_share[i] * b->axis[i][2]);
#else
  vd per_square = (double)GES_ROTORS * b->thrust_coefficient;
#endif
  vd speed = lane_sqrt(b->mass * b->gravity / lane_max(per_square, all_lanes(1e-12)));
  l->y[Y_P] = x;
  l->y[Y_P + 1] = y;
  l->y[Y_P + 2] = up + ground;
  l->y[Y_V] = vx;
  l->y[Y_Q] = all_lanes(1.0);
  for (int i = 0; i < ROTORS_OF(b); i++) l->y[Y_SPEED + i] = lane_min(speed, b->speed_max);
}

static void start_state(lanes_t *l, const double *const *p) {
  start_trimmed(l);
  vl given = GT(column(p, P_start), all_lanes(0.5));
  for (int k = 0; k < Y_X; k++) l->y[k] = sel(given, column(p, P_start_p_x_m + k), l->y[k]);
  vd *q = l->y + Y_Q, norm = lane_sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int k = 0; k < 4; k++) q[k] = q[k] / norm;
}

static void begin_effects(lanes_t *l) {
  const active_t *a = &l->active;
  l->sample.t = all_lanes(0.0);
  build_sample(&l->body, a, &l->ground, l->y, &l->sample);
  sample_center(&l->ground, &l->sample);
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->begin) a->effect[j]->begin(&l->sample, a->p[j], l->y + Y_X + a->first_state[j]);
}

static int load_lanes(lanes_t *l, const plan_t *plan, ges_flight *const *flights, const void *const *terrain) {
  const double *p[GES_W];
  const ges_effects *effects[GES_W];
  for (int i = 0; i < GES_W; i++) {
    p[i] = flights[i]->parameters;
    effects[i] = &flights[i]->effects;
  }
  memset(l, 0, sizeof *l);
  l->plan = plan;
  l->dt = column(p, P_dt_s);
  load_vehicle(&l->body, p);
  load_active(&l->active, plan, effects);
  ground_make(&l->ground, (const terrain_t *const *)terrain);
  load_noise(&l->noise, p);
  load_task(&l->task, p, flights);
  load_gains(&l->config, p);
  load_feedforward(&l->config, p);
  if (!load_belief(&l->config, plan, &l->body, p)) return 0;
  l->memory.range = to_float(l->noise.range_max);
  seed_streams(l->stream, p);
  memset(&l->report, 0xff, sizeof l->report); /* NaN until something is reported */
  l->n_y = Y_X + l->active.n_states;
  start_state(l, p);
  start_sample(&l->body, &l->active, &l->sample);
  begin_effects(l);
  return 1;
}

/* ---- sensors and firmware ---------------------------------------------------------------------------------- */

static vd noisy(vd value, vd sigma, stream_t *stream) {
  return any(GT(sigma, all_lanes(0.0))) ? value + sigma * normal(stream) : value;
}

static void read_telemetry(lanes_t *l, const reading_t *add) {
  const noise_t *n = &l->noise;
  const sample_t *s = &l->sample;
  reading_t *y = &l->reading;
  vd range = noisy(s->range + add->range, n->range, &l->stream[RANGE]);
  y->range = sel(LE(range, n->range_max), range, all_lanes(NAN));
  for (int i = 0; i < ROTORS_OF(s); i++) {
    y->rpm[i] = noisy(s->speed[i], n->rpm, &l->stream[TELEMETRY]);
    y->current[i] = noisy(n->idle + n->per_torque * s->torque[i], n->current, &l->stream[TELEMETRY]);
  }
}

/* Ground below the body now: sensors read it, and rows record it even where no firmware runs. */
static void see_ground(lanes_t *l) {
  sample_t *s = &l->sample;
  sample_center(&l->ground, s);
  s->ground_slope = lane_sqrt(s->ground.gx * s->ground.gx + s->ground.gy * s->ground.gy);
}

static void read_sensors(lanes_t *l, int k, vd attitude[9]) {
  reading_t add;
  sample_t *s = &l->sample;
  int telemetry = k % l->plan->telemetry_every == 0;
  s->range = range_to_ground(&l->ground, s);
  s->dt = (double)l->plan->control_every * l->dt;
  add_readings(&l->active, s, l->y, &add);
  for (int j = 0; j < 3; j++) l->reading.gyro[j] = noisy(s->omega[j] + add.gyro[j], l->noise.gyro, &l->stream[GYRO]);
  if (telemetry) read_telemetry(l, &add);
  for (int row = 0; row < 9; row += 3) {
    const vd *r = s->r + row, *e = add.attitude;
    attitude[row] = r[0] + (r[1] * e[2] - r[2] * e[1]);
    attitude[row + 1] = r[1] + (r[2] * e[0] - r[0] * e[2]);
    attitude[row + 2] = r[2] + (r[0] * e[1] - r[1] * e[0]);
  }
  for (int j = 0; j < 3; j++) {
    l->acc_error[j] = add.acc[j];
    l->reading.attitude[j] = add.attitude[j];
  }
}

/* Share of its depth that a descent has reached: down and up again in its duration by the terrain's quintic, then level. */
static vd descent_share(const task_t *task, vd t) {
  vd cycles = t / task->descent_period, since = (cycles - nearest(cycles - 0.5)) * task->descent_period;
  vd u = lane_min(since / task->descent_duration, all_lanes(1.0)) + 0.25;
  u = u - nearest(u);
  vd u2 = u * u;
  return 0.5 - 0.5 * (1.0 / 1.1721) * (u * (7.0 + u2 * (-40.0 + 48.0 * u2)));
}

static void cruise_reference(const lanes_t *l, fw_input *in) {
  const task_t *t = &l->task;
  const sample_t *s = &l->sample;
  for (int k = 0; k < 3; k++) in->p_ref[k] = in->v_ref[k] = in->a_ref[k] = number(0.0f);
  for (int k = 0; k < 4; k++) in->excitation[k] = number(0.0f);
  in->p_ref[0] = to_float(t->track_start + t->cruise * s->t);
  in->v_ref[0] = to_float(t->cruise);
  vd down = t->descent * descent_share(t, s->t);
  in->p_ref[2] = to_float(t->agl_ref - down);
  in->heading[0] = number(1.0f);
  in->heading[1] = number(0.0f);
}

static void table_reference(lanes_t *l, fw_input *in) {
  vf value[GES_REFERENCE_COLUMNS];
  place_t now;
  find_place(&l->task, GES_REFERENCE_COLUMNS, l->sample.t, &now);
  vd sine, cosine, yaw = input(&now, 9, 0);
  for (int k = 0; k < GES_REFERENCE_COLUMNS; k++) value[k] = to_float(input(&now, k, 0));
  for (int k = 0; k < 3; k++) {
    in->p_ref[k] = value[k];
    in->v_ref[k] = value[3 + k];
    in->a_ref[k] = value[6 + k];
  }
  for (int k = 0; k < 4; k++) in->excitation[k] = value[10 + k];
  lane_sin_cos(yaw, &sine, &cosine);
  in->heading[0] = to_float(cosine);
  in->heading[1] = to_float(sine);
  l->report.yaw_ref = yaw;
}

/* The oracle's truth: the factor here, or where the vehicle will be after the preview time. */
static void oracle(lanes_t *l, fw_input *in) {
  const sample_t *s = &l->sample;
  for (int i = 0; i < ROTORS_OF(s); i++) in->oracle[i] = to_float(s->factor[i]);
  if (!l->task.any_preview || !l->active.thrust_gain) return;
  sample_t ahead = *s;
  for (int k = 0; k < 2; k++) ahead.p[k] = s->p[k] + s->v[k] * l->task.preview;
  sample_rotors(&l->body, &l->ground, &ahead);
  l->active.thrust_gain(&ahead, l->active.thrust_gain_p, ahead.thrust_gain);
  ground_move(&l->ground, s->p[0]);
  vl looks = GT(l->task.preview, all_lanes(0.0));
  for (int i = 0; i < ROTORS_OF(s); i++) in->oracle[i] = to_float(sel(looks, 1.0 + ahead.thrust_gain[i], s->factor[i]));
}

static void firmware_sees(lanes_t *l, const vd attitude[9], fw_input *in) {
  const sample_t *s = &l->sample;
  in->t = to_float(s->t);
  in->dt = to_float((double)l->plan->control_every * l->dt);
  for (int k = 0; k < 9; k++) in->r[k] = to_float(attitude[k]);
  for (int k = 0; k < 3; k++) {
    in->gyro[k] = to_float(l->reading.gyro[k]);
    in->p[k] = to_float(noisy(s->p[k], l->noise.position, &l->stream[NAVIGATION]));
    in->v[k] = to_float(noisy(s->v[k], l->noise.velocity, &l->stream[NAVIGATION]));
  }
  in->range = to_float(l->reading.range);
  for (int i = 0; i < ROTORS_OF(s); i++) {
    in->rpm[i] = to_float(l->reading.rpm[i]);
    in->current[i] = to_float(l->reading.current[i]);
  }
}

static void report(lanes_t *l, const fw_input *in, const fw_output *out) {
  l->report.thrust_command = to_double(out->thrust_command);
  l->report.estimate = to_double(out->estimate);
  l->report.shadow = to_double(out->shadow);
  for (int k = 0; k < 3; k++) {
    l->report.p_ref[k] = to_double(in->p_ref[k]);
    l->report.v_ref[k] = to_double(in->v_ref[k]);
  }
}

static void run_firmware(lanes_t *l, const vd attitude[9]) {
  fw_input in;
  fw_output out;
  firmware_sees(l, attitude, &in);
  if (l->task.inputs[0]) table_reference(l, &in);
  else cruise_reference(l, &in);
  oracle(l, &in);
  firmware_run(&l->config, &in, &l->memory, &out);
  for (int i = 0; i < ROTORS_OF(&l->body); i++) l->sample.u[i] = to_double(out.u[i]);
  report(l, &in, &out);
}

static void run_nothing(lanes_t *l, const vd attitude[9]) { (void)l, (void)attitude; }

/* ---- what replays dictate ----------------------------------------------------------------------------------- */

/* Columns of the replay table: the drive of every rotor, then q, battery and omega. */
static void find_replayed(lanes_t *l) {
  find_place(&l->task, GES_REPLAY_COLUMNS + ROTORS_OF(&l->body), l->sample.t, &l->place);
  l->sample.battery = input(&l->place, ROTORS_OF(&l->body) + 4, 1);
}

static void impose_nothing(lanes_t *l, vd *y) { (void)l, (void)y; }

/* What the table says of every rotor. */
static void take_rotors(lanes_t *l, vd *rotors, int hold) {
  find_replayed(l);
  for (int i = 0; i < ROTORS_OF(&l->body); i++) rotors[i] = input(&l->place, i, hold);
}

static void impose_commands(lanes_t *l, vd *y) { (void)y, take_rotors(l, l->sample.u, 1); }

static void impose_commands_between(lanes_t *l, vd *y) { (void)y, take_rotors(l, l->sample.u, 0); }

static void impose_speeds(lanes_t *l, vd *y) { take_rotors(l, y + Y_SPEED, 0); }

/* After what imposes the drive, which found the place. */
static void impose_attitude(lanes_t *l, vd *y) {
  vd *q = y + Y_Q, norm = all_lanes(0.0);
  for (int k = 0; k < 4; k++) {
    q[k] = input(&l->place, ROTORS_OF(&l->body) + k, 0);
    norm += q[k] * q[k];
  }
  norm = lane_sqrt(norm);
  for (int k = 0; k < 4; k++) q[k] = q[k] / norm;
  for (int k = 0; k < 3; k++) y[Y_OMEGA + k] = input(&l->place, ROTORS_OF(&l->body) + 5 + k, 0);
}

typedef struct {
  void (*run)(lanes_t *l, const vd attitude[9]); /* attitude: as the sensors give it, row-major, body to world */
  void (*impose)(lanes_t *l, vd *y);
  int speeds_imposed;
} controller_t;

static const controller_t controllers[] = {
#define X(name, run, impose, speeds_imposed, input_columns, rotor_columns, doc) {run, impose, speeds_imposed},
#include "controllers.def"
#undef X
};

static void run_control(lanes_t *l, int k) {
  vd attitude[9];
  read_sensors(l, k, attitude);
  controllers[l->plan->control].run(l, attitude);
}

/* ---- the step ---------------------------------------------------------------------------------------------- */

static void quaternion_rate(const vd q[4], const vd w[3], vd dq[4]) {
  dq[0] = -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2]);
  dq[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
  dq[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]);
  dq[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
}

static void drive_rates(lanes_t *l, const vd *y, vd *dy) {
  drive_t d;
  sample_t *s = &l->sample;
  add_drive(&l->active, s, y, dy, &d);
  s->voltage = l->report.battery = voltage_of(s, &d);
  vd up = 1.0 / lane_max(d.lag_up, l->dt), down = 1.0 / lane_max(d.lag_down, l->dt); /* faster than a step: one step */
  for (int i = 0; i < ROTORS_OF(s); i++) {
    vd change = d.speed[i] - s->speed[i];
    vd rate = sel(GT(change, all_lanes(0.0)), up, down);
#if GES_GENERAL
    rate = lane_min(rate * s->inverse_lag_share[i], 1.0 / l->dt);
#endif
    s->speed_rate[i] = change * rate;
    dy[Y_SPEED + i] = controllers[l->plan->control].speeds_imposed ? all_lanes(0.0) : s->speed_rate[i];
  }
}

/* Newton and Euler: accelerations from the force and moment on the body. */
static void body_rates(lanes_t *l, const wrench_t *w, vd *dy) {
  vd moment[3];
  sample_t *s = &l->sample;
  sum_wrench(s, w, l->force, moment);
  add_contact(&l->body, s, l->force, moment);
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    dy[Y_V + k] = row_dot(s->r + 3 * k, l->force) * s->inverse_mass;
    dy[Y_OMEGA + k] = (moment[k] - (s->inertia[b] - s->inertia[a]) * s->omega[a] * s->omega[b]) * s->inverse_inertia[k];
  }
  dy[Y_V + 2] -= s->gravity;
  for (int k = 0; k < 3; k++) s->omega_dot[k] = dy[Y_OMEGA + k];
}

static void clear_wrench(const sample_t *s, wrench_t *w) {
  clear(w->thrust, ROTORS_OF(s));
  clear(w->force, 3);
  clear(w->moment, 3);
}

/* Rates dy of the state y at the sample's time; k >= 0: also run what is due at step k. */
static void rates(lanes_t *l, vd *y, vd *dy, int k) {
  wrench_t w;
  sample_t *s = &l->sample;
  const active_t *a = &l->active;
  controllers[l->plan->control].impose(l, y);
  if (l->plan->attitude_imposed) impose_attitude(l, y);
  clear_wrench(s, &w);
  clear(dy + Y_X, a->n_states);
  build_sample(&l->body, a, &l->ground, y, s);
  add_ground(a, s, y, dy, &w);
  if (k >= 0 && (k % l->plan->control_every == 0 || k % l->plan->record_every == 0)) {
    set_factor(s, w.thrust);
    see_ground(l);
    if (k % l->plan->control_every == 0) run_control(l, k);
  }
  drive_rates(l, y, dy);
  add_wrenches(a, s, y, dy, &w);
  body_rates(l, &w, dy);
}

static void normalise(vd q[4]) {
  vd scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int k = 0; k < 4; k++) q[k] = q[k] * scale;
}

static void position_rates(const vd *y, vd *dy) {
  for (int k = 0; k < 3; k++) dy[Y_P + k] = y[Y_V + k];
  quaternion_rate(y + Y_Q, y + Y_OMEGA, dy + Y_Q);
}

static void step_euler(lanes_t *l) {
  vd *y = l->y, *dy = l->dy;
  for (int k = Y_V; k < Y_Q; k++) y[k] += dy[k] * l->dt;
  for (int k = Y_OMEGA; k < l->n_y; k++) y[k] += dy[k] * l->dt;
  position_rates(y, dy);
  for (int k = 0; k < 3; k++) y[Y_P + k] += dy[Y_P + k] * l->dt;
  for (int k = 0; k < 4; k++) y[Y_Q + k] += dy[Y_Q + k] * l->dt;
  normalise(y + Y_Q);
}

/* The first stage's rates are in l->dy. */
static void step_runge_kutta(lanes_t *l, vd t) {
  static const double fraction[3] = {0.5, 0.5, 1.0}, weight[3] = {2.0, 2.0, 1.0};
  vd stage[Y_MAX], sum[Y_MAX], slope[Y_MAX];
  position_rates(l->y, l->dy);
  memcpy(sum, l->dy, sizeof(vd) * (size_t)l->n_y);
  memcpy(slope, l->dy, sizeof(vd) * (size_t)l->n_y);
  for (int j = 0; j < 3; j++) {
    for (int k = 0; k < l->n_y; k++) stage[k] = l->y[k] + slope[k] * (fraction[j] * l->dt);
    l->sample.t = t + fraction[j] * l->dt;
    rates(l, stage, slope, -1);
    position_rates(stage, slope);
    for (int k = 0; k < l->n_y; k++) sum[k] += weight[j] * slope[k];
  }
  for (int k = 0; k < l->n_y; k++) l->y[k] += sum[k] * (l->dt / 6.0);
  normalise(l->y + Y_Q);
}

/* ---- recording --------------------------------------------------------------------------------------------- */

static const char *const state_name[] = {
    "p_x_m", "p_y_m", "p_z_m", "v_x_m_s", "v_y_m_s", "v_z_m_s", "q_w", "q_x", "q_y", "q_z", "omega_x_rad_s", "omega_y_rad_s",
    "omega_z_rad_s",
#define ROTOR(i) "rotor_speed_" #i "_rad_s",
    EACH_ROTOR(ROTOR)
#undef ROTOR
};

/* First state of lane i that is not finite. */
static const char *bad_field(const lanes_t *l, int i) {
  for (int k = 0; k < l->n_y; k++) {
    double value = lane(l->y[k], i);
    if (!(value - value == 0.0)) return k < Y_X ? state_name[k] : "state of an effect";
  }
  return NULL;
}

static void stop_bad_lanes(const lanes_t *l, ges_flight *const *flights, int n, int row) {
  vd probe = all_lanes(0.0);
  for (int k = 0; k < l->n_y; k++) probe += l->y[k] * 0.0;
  if (!any(NE(probe, all_lanes(0.0)))) return;
  for (int i = 0; i < n; i++) {
    const char *field = flights[i]->stopped_row < 0 ? bad_field(l, i) : NULL;
    if (!field) continue;
    flights[i]->stopped_row = row;
    flights[i]->stopped_t_s = lane(l->sample.t, i);
    flights[i]->stopped_field = field;
  }
}

/* The attitude reading as a quaternion: q (1, e/2), e the small rotation by which the sensors turn it. */
static void read_attitude(const vd q[4], const vd e[3], vd out[4]) {
  vd rate[4], norm = all_lanes(0.0);
  quaternion_rate(q, e, rate);
  for (int k = 0; k < 4; k++) {
    out[k] = q[k] + rate[k];
    norm += out[k] * out[k];
  }
  for (int k = 0; k < 4; k++) out[k] = out[k] / lane_sqrt(norm);
}

static void fill_row(lanes_t *l, vd *row) {
  vd attitude[4];
  read_attitude(l->sample.q, l->reading.attitude, attitude);
  const sample_t *s = &l->sample;
  const reading_t *y = &l->reading;
  const report_t *fw = &l->report;
  for (int k = 0; k < 3; k++)
    l->reading.acc[k] = noisy(l->force[k] * s->inverse_mass + l->acc_error[k], l->noise.acc, &l->stream[ACCELERATION]);
#define X(name, unit, value, doc) row[C_##name] = value;
#define XR(name, suffix, unit, value, doc) \
  for (int i = 0; i < ROTORS_OF(s); i++) row[C_##name + i] = value;
#include "columns.def"
#undef X
#undef XR
}

static void record(lanes_t *l, ges_flight *const *flights, int n, int row, const int *columns, int n_columns) {
  vd value[N_COLUMNS];
  memset(value, 0xff, sizeof value); /* NaN, for rotors that there are not */
  fill_row(l, value);
  for (int i = 0; i < n; i++) {
    int stopped = flights[i]->stopped_row >= 0;
    double *out = flights[i]->out + (int64_t)row * n_columns;
    if (row >= flights[i]->n_rows) continue;
    for (int c = 0; c < n_columns; c++) out[c] = stopped ? NAN : lane(value[columns[c]], i);
  }
}

static int fly(const plan_t *plan, ges_flight *const *flights, const void *const *terrain, int n, const int *columns,
               int n_columns) {
  lanes_t l;
  ges_flight *padded[GES_W];
  const void *ground[GES_W];
  for (int i = 0; i < GES_W; i++) {
    padded[i] = flights[i < n ? i : n - 1];
    ground[i] = terrain[i < n ? i : n - 1];
  }
  if (!load_lanes(&l, plan, padded, ground)) return 0;
  for (int k = 0; k <= plan->n_steps; k++) {
    int due = k % plan->record_every == 0;
    vd t = (double)k * l.dt;
    l.sample.t = t;
    if (due || k % plan->control_every == 0) stop_bad_lanes(&l, flights, n, (k + plan->record_every - 1) / plan->record_every);
    rates(&l, l.y, l.dy, k);
    if (due) record(&l, flights, n, k / plan->record_every, columns, n_columns);
    if (plan->integrator == 0) step_euler(&l);
    else step_runge_kutta(&l, t);
  }
  return 1;
}

/* ---- replay ------------------------------------------------------------------------------------------------ */

/* Effects along recorded samples: the sample is built from the recording, nothing is integrated but extra states. */
typedef struct {
  vehicle_t body;
  active_t active;
  ground_lanes_t ground;
  sample_t sample;
  vd y[Y_MAX], dy[Y_MAX];
  vd force[3], moment[3];
  wrench_t wrench;
  drive_t drive;
  reading_t reading;
  const int *columns; /* of a replay, that are given */
  int n_columns;
} replay_t;

/* Whether the lanes hold samples one after another, which move as one vector. */
static int in_a_row(const int64_t *at) { return at[GES_W - 1] - at[0] == GES_W - 1; }

static vd gather(const double *in, int64_t n, int column_index, const int64_t *at) {
  const double *column_start = in + (int64_t)column_index * n;
  vd v = all_lanes(0.0);
  if (in_a_row(at)) memcpy(&v, column_start + at[0], sizeof v);
  else
    for (int i = 0; i < GES_W; i++) set_lane(&v, i, column_start[at[i]]);
  return v;
}

static void read_sample(replay_t *r, const double *in, int64_t n, const int64_t *at) {
  sample_t *s = &r->sample;
  s->t = gather(in, n, IN_t_s, at);
  for (int k = 0; k < Y_SPEED; k++) r->y[k] = gather(in, n, IN_p_x_m + k, at);
  for (int k = 0; k < 3; k++) s->omega_dot[k] = gather(in, n, IN_omega_dot_x_rad_s2 + k, at);
  for (int i = 0; i < ROTORS_OF(s); i++) {
    r->y[Y_SPEED + i] = gather(in, n, N_REPLAY_IN + IN_rotor_speed_ * ROTORS_OF(s) + i, at);
    s->speed_rate[i] = gather(in, n, N_REPLAY_IN + IN_rotor_acceleration_ * ROTORS_OF(s) + i, at);
    s->u[i] = gather(in, n, N_REPLAY_IN + IN_u_ * ROTORS_OF(s) + i, at);
  }
  s->battery = gather(in, n, IN_battery_V, at);
}

static void evaluate_drive(replay_t *r) {
  const active_t *a = &r->active;
  sample_t *s = &r->sample;
  clear_wrench(s, &r->wrench);
  clear(r->dy + Y_X, a->n_states);
  add_ground(a, s, r->y, r->dy, &r->wrench);
  set_factor(s, r->wrench.thrust);
  add_drive(a, s, r->y, r->dy, &r->drive);
  s->voltage = voltage_of(s, &r->drive);
}

static void evaluate(replay_t *r) {
  evaluate_drive(r);
  add_wrenches(&r->active, &r->sample, r->y, r->dy, &r->wrench);
  sum_wrench(&r->sample, &r->wrench, r->force, r->moment);
}

/* Rates of extra states alone: forces of effects that have none do not count. */
static void evaluate_rates(replay_t *r) {
  const active_t *a = &r->active;
  evaluate_drive(r);
  for (int j = 0; j < a->n; j++)
    if (has_rates(a->effect[j])) add_wrench(a, j, &r->sample, r->y, r->dy, &r->wrench);
}

static void see_sample(replay_t *r, const double *in, int64_t n, const int64_t *at) {
  read_sample(r, in, n, at);
  build_sample(&r->body, &r->active, &r->ground, r->y, &r->sample);
  sample_center(&r->ground, &r->sample);
  r->sample.range = range_to_ground(&r->ground, &r->sample);
  evaluate(r);
}

/* Lane i goes to sample at[i] of out[i]. */
static void write_sample(const replay_t *replay, double *const *out, int64_t n, const int64_t *at, int filled) {
  const sample_t *s = &replay->sample;
  const wrench_t *w = &replay->wrench;
  const drive_t *d = &replay->drive;
  const reading_t *r = &replay->reading;
  const vd *force = replay->force, *moment = replay->moment;
  vd value[N_REPLAY_OUT + N_REPLAY_OUT_ROTOR * GES_ROTORS];
#define X(name, unit, expression, doc) value[OUT_##name] = expression;
#define XR(name, suffix, unit, expression, doc) \
  for (int i = 0; i < ROTORS_OF(s); i++) value[N_REPLAY_OUT + OUT_##name * ROTORS_OF(s) + i] = expression;
#include "replay_out.def"
#undef X
#undef XR
  int together = filled == GES_W && in_a_row(at);
  for (int c = 0; c < replay->n_columns; c++) {
    const vd *given = &value[replay->columns[c]];
    if (together) memcpy(out[0] + (int64_t)c * n + at[0], given, sizeof *given);
    else
      for (int i = 0; i < filled; i++) out[i][(int64_t)c * n + at[i]] = lane(*given, i);
  }
}

static void load_replay(replay_t *r, const double *parameters, const plan_t *plan, const ges_effects *const *sets, int n_sets,
                        const void *terrain) {
  const double *p[GES_W];
  const ges_effects *e[GES_W];
  const terrain_t *t[GES_W];
  for (int i = 0; i < GES_W; i++) {
    p[i] = parameters;
    e[i] = sets[i < n_sets ? i : n_sets - 1];
    t[i] = terrain;
  }
  memset(r, 0, sizeof *r);
  load_vehicle(&r->body, p);
  load_active(&r->active, plan, e);
  ground_make(&r->ground, t);
  start_sample(&r->body, &r->active, &r->sample);
}

static void begin_replay(replay_t *r) {
  const active_t *a = &r->active;
  for (int j = 0; j < a->n; j++)
    if (a->effect[j]->begin) a->effect[j]->begin(&r->sample, a->p[j], r->y + Y_X + a->first_state[j]);
}

/* Position and velocity of a sample. */
typedef struct {
  vd p[3], v[3];
} motion_t;

static motion_t motion_of(const sample_t *s) {
  motion_t m;
  memcpy(m.p, s->p, sizeof m.p);
  memcpy(m.v, s->v, sizeof m.v);
  return m;
}

static void move(sample_t *s, const motion_t *from, const motion_t *to, double share) {
  for (int k = 0; k < 3; k++) {
    s->p[k] = from->p[k] + share * (to->p[k] - from->p[k]);
    s->v[k] = from->v[k] + share * (to->v[k] - from->v[k]);
  }
}

/* Extra states over the time since the sample before, by the midpoint rule in steps of at most GES_STATE_STEP_S, position
 * and velocity on straight lines between the samples; gaps over 0.1 s are cut. */
static void advance_states(replay_t *r, const motion_t *before) {
  if (!r->active.any_rates) return;
  double dt = lane(r->sample.dt, 0);
  int steps = (int)ceil(dt / GES_STATE_STEP_S - 1e-6);
  vd end = r->sample.t, start[Y_MAX - Y_X], *x = r->y + Y_X, *dx = r->dy + Y_X;
  motion_t now = motion_of(&r->sample);
  for (int half = 0; half < 2 * steps; half++) {
    double ahead = dt / steps * (half % 2 ? 1.0 : 0.5);
    if (half % 2 == 0) memcpy(start, x, sizeof(vd) * (size_t)r->active.n_states);
    r->sample.t = end - dt * (1.0 - 0.5 * half / steps);
    move(&r->sample, before, &now, 0.5 * half / steps);
    evaluate_rates(r);
    for (int k = 0; k < r->active.n_states; k++) x[k] = start[k] + dx[k] * ahead;
  }
  r->sample.t = end;
  memcpy(r->sample.p, now.p, sizeof now.p);
  memcpy(r->sample.v, now.v, sizeof now.v);
}

/* Lanes of samples: nothing is remembered from one to the next. */
static void replay_samples(replay_t *r, double *out, const double *in, int64_t n) {
  int64_t at[GES_W];
  double *all[GES_W];
  for (int i = 0; i < GES_W; i++) all[i] = out;
  for (int64_t first = 0; first < n; first += GES_W) {
    int filled = n - first < GES_W ? (int)(n - first) : GES_W;
    for (int i = 0; i < GES_W; i++) at[i] = first + (i < filled ? i : filled - 1);
    see_sample(r, in, n, at);
    add_readings(&r->active, &r->sample, r->y, &r->reading);
    write_sample(r, all, n, at, filled);
  }
}

/* Lanes of sets, through the samples in order. */
static void replay_in_order(replay_t *r, double *const *out, int n_sets, const double *in, int64_t n) {
  motion_t before;
  int64_t at[GES_W];
  for (int64_t now = 0; now < n; now++) {
    for (int i = 0; i < GES_W; i++) at[i] = now;
    see_sample(r, in, n, at);
    if (now == 0) begin_replay(r);
    else {
      r->sample.dt = all_lanes(bounded(in[now] - in[now - 1], 0.1));
      advance_states(r, &before);
    }
    before = motion_of(&r->sample);
    sample_air(&r->active, r->y, &r->sample);
    evaluate(r);
    add_readings(&r->active, &r->sample, r->y, &r->reading);
    write_sample(r, out, n, at, n_sets);
  }
}

static void replay(const double *parameters, const plan_t *plan, const ges_effects *const *sets, double *const *out, int n_sets,
                   const void *terrain, const double *in, int64_t n, const int *columns, int n_columns) {
  replay_t r;
  load_replay(&r, parameters, plan, sets, n_sets, terrain);
  r.columns = columns;
  r.n_columns = n_columns;
  if (r.active.n_states > 0) replay_in_order(&r, out, n_sets, in, n);
  else replay_samples(&r, out[0], in, n);
}

const kernel_t PER_UNIT(kernel) = {GES_W, fly, replay};
