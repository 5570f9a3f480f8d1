/* placeholder until exported */
#define GES_MLP_IN 13
#define GES_MLP_HIDDEN1 64
#define GES_MLP_HIDDEN2 32
static const float ges_mlp_mean[13] = {0};
static const float ges_mlp_scale[13] = {1,1,1,1,1,1,1,1,1,1,1,1,1};
static const float ges_mlp_w1[64 * 13] = {0};
static const float ges_mlp_b1[64] = {0};
static const float ges_mlp_w2[32 * 64] = {0};
static const float ges_mlp_b2[32] = {0};
static const float ges_mlp_w3[32] = {0};
static const float ges_mlp_b3[1] = {0};
static const float ges_mlp_out_mean = 1.0f, ges_mlp_out_scale = 1.0f;
static const float ges_mlp_sample_in[13] = {0};
static const float ges_mlp_sample_out = 1.0f;
