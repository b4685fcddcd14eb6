"""One thread for the algorithms: the same bytes of result everywhere, and the other core left to the other services."""

import cv2
import threadpoolctl


def one_thread() -> None:
    """Holds BLAS and OpenCV to one thread in this process, from now on."""
    threadpoolctl.threadpool_limits(1)
    cv2.setNumThreads(1)
