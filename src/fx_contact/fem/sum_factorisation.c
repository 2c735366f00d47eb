/* The stiffness of hexahedra of degree 2 cell by cell, four of them at once.

   Before this text stand the tables
       six[3][3]             position of each component of a symmetric tensor,
       value[3][3]           functions at the Gauss points of an axis, value_back[3][3] its transpose,
       slope[3][3]           derivatives at these points by values there, slope_back[3][3] its transpose,
       weight[27]            of the rule,
       gradient[3][27][27]   reference gradients of the functions, by axis, point and function,
   and arguments of the functions are the law (6, 6) of all cells and, by groups of four, nodes (27, 4), metric
   (points, 9, 4) of one or 27 points, and polynomials (27, 4, 4), 0 where volume strains are not projected. */

#include <stdint.h>

/* One number of each cell. */
typedef double lanes __attribute__((vector_size(32), aligned(8)));
#define INLINE static inline __attribute__((always_inline))

/* v := M u along an axis on which the next number is s further, or v := v + M u; v may be u. */
INLINE void along(const double m[3][3], int s, const lanes *u, lanes *v, int add)
{
    for (int first = 0; first < 27; first += 3 * s)
        for (int i = first; i < first + s; i++) {
            const lanes a = u[i], b = u[i + s], c = u[i + 2 * s];
            for (int r = 0; r < 3; r++) {
                const lanes sum = m[r][0] * a + m[r][1] * b + m[r][2] * c;
                v[i + r * s] = add ? v[i + r * s] + sum : sum;
            }
        }
}

/* y := y + K u; without y returns u^T K u. */
double add_product(int64_t groups, const int32_t *nodes, const double *law, int points,
                   const lanes *metric, const lanes *polynomials, const double *u, double *y)
{
    lanes energy = {};
    int decoupled = 1; /* shears from normal strains and from each other, as in isotropic materials */
    for (int i = 0; i < 36; i++)
        decoupled &= (i / 6 < 3 && i % 6 < 3) || i / 6 == i % 6 || law[i] == 0;
    for (int64_t group = 0; group < groups; group++, nodes += 108, metric += 9 * points) {
        lanes v[3][27], g[3][3][27], p[27];
        for (int i = 0; i < 27; i++) {
            const double *at[4];
            for (int l = 0; l < 4; l++)
                at[l] = u + 3 * (int64_t)nodes[4 * i + l];
            for (int k = 0; k < 3; k++)
                v[k][i] = (lanes){at[0][k], at[1][k], at[2][k], at[3][k]};
        }
        for (int k = 0; k < 3; k++) {
            along(value, 1, v[k], v[k], 0);
            along(value, 3, v[k], v[k], 0);
            along(value, 9, v[k], v[k], 0);
            along(slope, 1, v[k], g[k][0], 0);
            along(slope, 3, v[k], g[k][1], 0);
            along(slope, 9, v[k], g[k][2], 0);
        }
        if (polynomials) {
            lanes moment[4] = {};
            for (int q = 0; q < 27; q++) {
                const lanes *m = metric + (points > 1) * 9 * q;
                lanes d = {};
                for (int k = 0; k < 3; k++)
                    d += m[3 * k] * g[k][0][q] + m[3 * k + 1] * g[k][1][q] + m[3 * k + 2] * g[k][2][q];
                for (int r = 0; r < 4; r++)
                    moment[r] += polynomials[4 * q + r] * d;
            }
            for (int q = 0; q < 27; q++, polynomials += 4)
                p[q] = polynomials[0] * moment[0] + polynomials[1] * moment[1] + polynomials[2] * moment[2] +
                       polynomials[3] * moment[3];
        }
        for (int q = 0; q < 27; q++) {
            const lanes *m = metric + (points > 1) * 9 * q;
            lanes h[3][3], strain[6], stress[6];
            for (int k = 0; k < 3; k++)
                for (int i = 0; i < 3; i++)
                    h[k][i] = m[3 * i] * g[k][0][q] + m[3 * i + 1] * g[k][1][q] + m[3 * i + 2] * g[k][2][q];
            for (int i = 0; i < 3; i++)
                for (int k = 0; k <= i; k++)
                    strain[six[i][k]] = i == k ? h[i][i] : h[i][k] + h[k][i];
            for (int i = 0; i < 6; i++) {
                const double *row = law + 6 * i;
                stress[i] = row[0] * strain[0] + row[1] * strain[1] + row[2] * strain[2];
                if (decoupled)
                    stress[i] = i < 3 ? stress[i] : row[i] * strain[i];
                else
                    stress[i] += row[3] * strain[3] + row[4] * strain[4] + row[5] * strain[5];
                stress[i] *= weight[q];
                if (polynomials && i < 3)
                    stress[i] += p[q];
                if (!y)
                    energy += strain[i] * stress[i];
            }
            for (int k = 0; k < 3; k++)
                for (int axis = 0; axis < 3; axis++)
                    g[k][axis][q] = m[axis] * stress[six[k][0]] + m[3 + axis] * stress[six[k][1]] +
                                    m[6 + axis] * stress[six[k][2]];
        }
        if (!y)
            continue;
        for (int k = 0; k < 3; k++) {
            along(slope_back, 1, g[k][0], v[k], 0);
            along(slope_back, 3, g[k][1], v[k], 1);
            along(slope_back, 9, g[k][2], v[k], 1);
            along(value_back, 1, v[k], v[k], 0);
            along(value_back, 3, v[k], v[k], 0);
            along(value_back, 9, v[k], v[k], 0);
        }
        for (int i = 0; i < 27; i++)
            for (int l = 0; l < 4; l++)
                for (int k = 0; k < 3; k++)
                    y[3 * (int64_t)nodes[4 * i + l] + k] += v[k][i][l];
    }
    return energy[0] + energy[1] + energy[2] + energy[3];
}

/* y := y + the blocks of 3 x 3 on the diagonal of each K, by nodes. */
void add_diagonal(int64_t groups, const int32_t *nodes, const double *law, int points,
                  const lanes *metric, const lanes *polynomials, double *y)
{
    for (int64_t group = 0; group < groups; group++, nodes += 108, metric += 9 * points) {
        for (int a = 0; a < 27; a++) {
            lanes square[3][3] = {}, of_volume[4][3] = {};
            for (int q = 0; q < 27; q++) {
                const lanes *m = metric + (points > 1) * 9 * q;
                lanes h[3];
                for (int i = 0; i < 3; i++)
                    h[i] = m[3 * i] * gradient[0][q][a] + m[3 * i + 1] * gradient[1][q][a] + m[3 * i + 2] * gradient[2][q][a];
                for (int i = 0; i < 3; i++)
                    for (int k = 0; k < 3; k++)
                        square[i][k] += weight[q] * h[i] * h[k];
                for (int r = 0; polynomials && r < 4; r++)
                    for (int i = 0; i < 3; i++)
                        of_volume[r][i] += polynomials[4 * q + r] * h[i];
            }
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    lanes sum = {};
                    for (int k = 0; k < 3; k++)
                        for (int l = 0; l < 3; l++)
                            sum += law[6 * six[i][k] + six[j][l]] * square[k][l];
                    for (int r = 0; r < 4; r++)
                        sum += of_volume[r][i] * of_volume[r][j];
                    for (int l = 0; l < 4; l++)
                        y[9 * (int64_t)nodes[4 * a + l] + 3 * i + j] += sum[l];
                }
        }
        if (polynomials)
            polynomials += 4 * 27;
    }
}
