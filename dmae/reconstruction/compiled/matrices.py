"""Symmetric matrices (3, 3), compiled."""

import numpy as np

from dmae.numerics.compiled import compiled


@compiled()
def cholesky(matrix, factor):
    """Write the lower factor of a positive definite matrix (3, 3)."""
    for row in range(3):
        for column in range(row + 1):
            total = matrix[row, column]
            for k in range(column):
                total -= factor[row, k] * factor[column, k]
            if row == column:
                factor[row, row] = np.sqrt(max(total, 1e-300))
            else:
                factor[row, column] = total / factor[column, column]


@compiled()
def solve(factor, vector):
    """Solve L L^T x = vector in place."""
    for row in range(3):
        for k in range(row):
            vector[row] -= factor[row, k] * vector[k]
        vector[row] /= factor[row, row]
    for row in range(2, -1, -1):
        for k in range(row + 1, 3):
            vector[row] -= factor[k, row] * vector[k]
        vector[row] /= factor[row, row]


@compiled()
def largest_eigenvalue(matrix):
    """Return the largest eigenvalue of a symmetric matrix (3, 3), in closed form."""
    aside = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3
    a, b, c = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    spread = np.sqrt((a * a + b * b + c * c + 2 * aside) / 6)
    if spread == 0:
        return mean
    determinant = (
        a * (b * c - matrix[1, 2] ** 2)
        - matrix[0, 1] * (matrix[0, 1] * c - matrix[1, 2] * matrix[0, 2])
        + matrix[0, 2] * (matrix[0, 1] * matrix[1, 2] - b * matrix[0, 2])
    )
    half = min(max(determinant / (2 * spread**3), -1.0), 1.0)
    return mean + 2 * spread * np.cos(np.arccos(half) / 3)
