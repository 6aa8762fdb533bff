#!/usr/bin/env python3
"""
README / what this measures
===========================
Honest baseline: how long do SciPy's general-purpose ODE solvers need for ONE
simulated second of the classic 8-DOF (Tian/Wu/Zuo-type) spur-gear pair, and
how accurate is the ACCELERATION they deliver?  It is the reference that our
own Rust integrator is to be compared with, nothing more.

Model (written from the equations of motion, not taken from any package)
  q = [theta_m, theta_1, theta_2, theta_b, x1, y1, x2, y2]   (deviations from
      the nominal rigid rotation, so nothing drifts to large angles)
  delta = rb1*theta_1 - rb2*theta_2 + (x1-x2) sin(a) + (y1-y2) cos(a)
  F     = k(t)*delta + c_m(t)*delta',     c_m = 2*zeta*sqrt(k*m_e)
  Motor and load are tied to the gears by torsional springs/dampers kp,cp and
  kg,cg; each gear centre sits on k_b,c_b in x and y.  Torque 11.9 N m in,
  11.9*48/19 out, shaft 30 Hz -> mesh 570 Hz, 1140 stiffness jumps per second.

Mesh stiffness
  'square' : constant k in the double and in the single zone (jump at the
             boundaries) -> the system is piecewise LTI and its EXACT solution
             is known through matrix exponentials.  That is the truth used
             for every error below.
  'energy' : smooth within a zone (bending+shear+axial+Hertz+gear body by the
             energy method), still jumps at the boundaries.
             Truth = DOP853, restarted at every jump, rtol 1e-13.
Parameter sets
  'sane'    : c_b = 1.8e3 N s/m, cp=cg = 2*0.05*sqrt(k*I_red)
  'printed' : c_b = 1.8e5 N s/m, cp=cg = 5.0e5 N m s/rad  (as often printed;
              see the eigenvalue line the script prints for what that implies)

Columns
  naive    : one call over the whole interval, solver steps across the jumps
  segment  : restarted exactly at each jump (what an event-aware code does)
  s/s      : seconds of processor time per simulated second (median of `reps`)
  nfev     : right-hand-side evaluations per simulated second
  errA     : RMS error of the y1 acceleration on a fixed grid of `nper`
             mid-cell samples per stiffness zone, divided by the RMS of the
             true y1 acceleration (AC part).  Dense output of the solver is
             used between its steps; evaluating it is NOT in the timing.
Machine load matters: run on an idle machine, one thread.
A pure-Python right-hand side would only raise the explicit solvers' s/s.
Usage:  python scipy_gear_baseline.py [--T 0.05] [--reps 1] [--quick]
Needs:  numpy, scipy; numba optional (only makes the RHS cheaper).
"""
import argparse, os, sys, time
for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(v, "1")
import numpy as np
import scipy
from scipy.integrate import solve_ivp, quad
from scipy.linalg import expm

try:
    from numba import njit
    HAVE_NUMBA = True
except Exception:                                     # pragma: no cover
    HAVE_NUMBA = False
    def njit(*a, **k):
        return (lambda f: f) if not (a and callable(a[0])) else a[0]

# ----------------------------------------------------------------- parameters
Z1, Z2, MOD, WID, AL = 19, 48, 3.175e-3, 16e-3, np.deg2rad(20.0)
E, NU = 2.068e11, 0.3
IM, I1, I2, IB = 0.0021, 4.3659e-4, 8.3602e-3, 0.0105
M1, M2 = 0.96, 2.88
KP = KG = 4.4e4
KB = 6.56e7
TORQ, FS = 11.9, 30.0
ZETA_MESH = 0.03
RB1, RB2 = 0.5*MOD*Z1*np.cos(AL), 0.5*MOD*Z2*np.cos(AL)
RA1, RA2 = 0.5*MOD*(Z1+2), 0.5*MOD*(Z2+2)
PB = np.pi*MOD*np.cos(AL)
CR = (np.sqrt(RA1**2-RB1**2)+np.sqrt(RA2**2-RB2**2)-0.5*MOD*(Z1+Z2)*np.sin(AL))/PB
FM = FS*Z1
TM = 1.0/FM
TD = (CR-1.0)*TM                                       # double-contact part


def damp(kind):
    if kind == "printed":
        return 5.0e5, 5.0e5, 1.8e5
    ir1, ir2 = IM*I1/(IM+I1), I2*IB/(I2+IB)
    return 2*0.05*np.sqrt(KP*ir1), 2*0.05*np.sqrt(KG*ir2), 1.8e3


HA, CL = 1.0, 0.25                                     # addendum, tip clearance
BORE = {Z1: 9.6e-3, Z2: 26.5e-3}                       # bore radii, r_root/r_bore = 2.73
SAINSOT = ((-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045),
           (60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086),
           (-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236),
           (-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904))
BODY = True
ROOT = True


def body_compliance(z, a1):
    """Sainsot/Velex/Duverger 2004 elastic-ring fit; u measured from the root
    circle to where the line of action cuts the tooth centre line."""
    rb = 0.5*MOD*z*np.cos(AL); rf = 0.5*MOD*z-(HA+CL)*MOD
    rho = CL/(1-np.sin(AL))
    tf = (np.pi/2+2*np.tan(AL)*(HA-rho)+2*rho/np.cos(AL))/z
    h = rf/BORE[z]
    L, M, P, Q = (A/tf**2+B*h*h+C*h/tf+D/tf+Ec*h+F for (A, B, C, D, Ec, F) in SAINSOT)
    u, sf = rb/np.cos(a1)-rf, 2*rf*tf
    return np.cos(a1)**2/(E*WID)*(L*(u/sf)**2+M*u/sf+P*(1+Q*np.tan(a1)**2))


def tooth_compliance(z, a1):
    """1/kb+1/ks+1/ka(+1/kf).  Involute flank from the base (or root) circle;
    if the root circle lies inside the base circle a straight radial stub of
    the base-circle thickness is added down to the root circle (ROOT)."""
    a2 = np.pi/(2*z) + np.tan(AL) - AL
    rb = 0.5*MOD*z*np.cos(AL); rf = 0.5*MOD*z-(HA+CL)*MOD
    def den(a): return np.sin(a)+(a2-a)*np.cos(a)
    fb = lambda a: 3*(1+np.cos(a1)*((a2-a)*np.sin(a)-np.cos(a)))**2*(a2-a)*np.cos(a)/(2*E*WID*den(a)**3)
    fs = lambda a: 1.2*(1+NU)*(a2-a)*np.cos(a)*np.cos(a1)**2/(E*WID*den(a))
    fa = lambda a: (a2-a)*np.cos(a)*np.sin(a1)**2/(2*E*WID*den(a))
    up = a2
    if ROOT and rf > rb:
        up = a2-np.tan(np.arccos(rb/rf))
    c = sum(quad(f, -a1, up, epsrel=1e-11, limit=200)[0] for f in (fb, fs, fa))
    if ROOT and rf < rb:
        hb = rb*np.sin(a2); l = rb*np.cos(a2)-rf; I = 2.0/3*hb**3*WID; A = 2*hb*WID
        d = rb/np.cos(a1)-rb*np.cos(a2)             # lever of the resultant at the base circle
        ca = np.cos(a1)
        c += ca*ca*((d+l)**3-d**3)/(3*E*I) + 1.2*ca*ca*l*2*(1+NU)/(E*A) + np.sin(a1)**2*l/(E*A)
    return c + (body_compliance(z, a1) if BODY else 0.0)


def pair_stiffness(th):
    """th = pinion rotation (rad) since this pair came into contact."""
    inv = np.tan(AL)-AL
    phi_s = ((0.5*MOD*(Z1+Z2))*np.sin(AL)-np.sqrt(RA2**2-RB2**2))/RB1   # roll angle at SAP
    a1p = phi_s + th - np.pi/(2*Z1) - inv
    a1g = np.tan(np.arccos(RB2/RA2)) - np.pi/(2*Z2) - inv - th*Z1/Z2
    kh = np.pi*E*WID/(4*(1-NU**2))
    return 1.0/(1.0/kh + tooth_compliance(Z1, a1p) + tooth_compliance(Z2, a1g))


def energy_table(n=60):
    from numpy.polynomial import chebyshev as C
    p = 2*np.pi/Z1
    x = np.cos(np.pi*(np.arange(n)+0.5)/n)
    th = 0.5*(x+1)*CR*p
    k = np.array([pair_stiffness(t) for t in th])
    return C.chebfit(x, k, n-1), p


CH, PITCH = energy_table()


def k_energy(tau):
    """tau in [0,TM): time since a new pair entered."""
    from numpy.polynomial import chebyshev as C
    p = PITCH
    th = tau/TM*p
    k = C.chebval(2*th/(CR*p)-1, CH)
    th2 = th+p
    return k + np.where(th2 <= CR*p, C.chebval(np.minimum(2*th2/(CR*p)-1, 1.0), CH), 0.0)


_tau = (np.arange(2000)+0.5)/2000*TM
_k = k_energy(_tau)
K2, K1 = float(_k[_tau < TD].mean()), float(_k[_tau > TD].mean())

# ------------------------------------------------------------------ matrices
H = np.array([0, RB1, -RB2, 0, np.sin(AL), np.cos(AL), -np.sin(AL), -np.cos(AL)])
MASS = np.array([IM, I1, I2, IB, M1, M1, M2, M2])
ME = 1.0/np.sum(H[1:3]**2/MASS[1:3])


def base(kind):
    cp, cg, cb = damp(kind)
    K0, C0 = np.zeros((8, 8)), np.zeros((8, 8))
    for (i, j, k, c) in ((0, 1, KP, cp), (2, 3, KG, cg)):
        for A, v in ((K0, k), (C0, c)):
            A[i, i] += v; A[j, j] += v; A[i, j] -= v; A[j, i] -= v
    for i in range(4, 8):
        K0[i, i] += KB; C0[i, i] += cb
    return K0, C0


FEXT = np.zeros(8); FEXT[0] = TORQ; FEXT[3] = -TORQ*Z2/Z1


def amat(kind, k):
    K0, C0 = base(kind)
    cm = 2*ZETA_MESH*np.sqrt(k*ME)
    S = np.outer(H, H)
    A = np.zeros((16, 16)); A[:8, 8:] = np.eye(8)
    A[8:, :8] = -(K0+k*S)/MASS[:, None]; A[8:, 8:] = -(C0+cm*S)/MASS[:, None]
    return A


def k_of(t, shape):
    tau = np.mod(t, TM)
    if shape == "square":
        return np.where(tau < TD, K2, K1)
    return k_energy(tau)


def static(kind):
    K0, _ = base(kind)
    km = (K2*TD+K1*(TM-TD))/TM
    q = np.linalg.lstsq(K0+km*np.outer(H, H), FEXT, rcond=None)[0]
    return np.concatenate([q, np.zeros(8)])


# fast right-hand side ------------------------------------------------------
@njit(cache=False)
def rhs_core(y, k, K0, C0, Hv, mass, f, zeta, me):
    out = np.empty(16)
    d = 0.0; dd = 0.0
    for i in range(8):
        d += Hv[i]*y[i]; dd += Hv[i]*y[8+i]
    F = k*d + 2*zeta*np.sqrt(k*me)*dd
    for i in range(8):
        s = f[i] - Hv[i]*F
        for j in range(8):
            s -= K0[i, j]*y[j] + C0[i, j]*y[8+j]
        out[i] = y[8+i]
        out[8+i] = s/mass[i]
    return out


def make_rhs(kind, shape, kfix=None):
    K0, C0 = base(kind)
    tab_t = None
    if shape == "energy":
        n = 4096
        ga = np.linspace(0, TD, n); gb = np.linspace(TD, TM, n)
        ka = k_energy(np.minimum(ga, TD*(1-1e-12))); kb = k_energy(np.minimum(gb+1e-15, TM*(1-1e-15)))
        from scipy.interpolate import CubicSpline
        sa, sb = CubicSpline(ga, ka), CubicSpline(gb, kb)
        ca, cb_ = sa.c, sb.c
        ha, hb = ga[1]-ga[0], gb[1]-gb[0]
        def kf(t, zone=None):
            tau = t % TM
            z = zone if zone is not None else (0 if tau < TD else 1)
            if z == 0:
                if tau > 0.5*(TD+TM): tau = 0.0
                i = min(int(tau/ha), n-2); u = tau-i*ha; c = ca[:, i]
            else:
                if tau < 0.5*TD: tau = TM
                i = min(max(int((tau-TD)/hb), 0), n-2); u = tau-TD-i*hb; c = cb_[:, i]
            return ((c[0]*u+c[1])*u+c[2])*u+c[3]
    else:
        def kf(t, zone=None):
            z = zone if zone is not None else (0 if (t % TM) < TD else 1)
            return K2 if z == 0 else K1
    def rhs(t, y, zone=None):
        return rhs_core(y, kf(t, zone), K0, C0, H, MASS, FEXT, ZETA_MESH, ME)
    return rhs, kf


def y1acc(kind, kf, t, Y, zone=None):
    K0, C0 = base(kind)
    k = np.array([kf(tt, zone) for tt in t])
    d = H@Y[:8]; dd = H@Y[8:]
    F = k*d+2*ZETA_MESH*np.sqrt(k*ME)*dd
    return (FEXT[5]-H[5]*F-K0[5]@Y[:8]-C0[5]@Y[8:])/M1


# exact piecewise-LTI propagation -------------------------------------------
def segments(T):
    out, n = [], 0
    while n*TM < T:
        out.append((n*TM, min(n*TM+TD, T), 0))
        if n*TM+TD < T: out.append((n*TM+TD, min((n+1)*TM, T), 1))
        n += 1
    return out


def exact(kind, T, nper):
    """samples nper points per segment (mid-cell), returns t, acc, states, cost"""
    A = [amat(kind, K2), amat(kind, K1)]
    b = np.zeros(16); b[8:] = FEXT/MASS
    aug = []
    for a in A:
        G = np.zeros((17, 17)); G[:16, :16] = a; G[:16, 16] = b; aug.append(G)
    y = np.append(static(kind), 1.0)
    ts, ac, st = [], [], []
    cache = {}
    t0 = time.process_time()
    for (a, e, z) in segments(T):
        L = e-a; key = (z, round(L*1e12))
        if key not in cache:
            cache[key] = (expm(aug[z]*L/(2*nper)), expm(aug[z]*L/nper))
        half, full = cache[key]
        s = half@y
        for i in range(nper):
            ts.append(a+(i+0.5)*L/nper); st.append(s[:16]); ac.append((aug[z]@s)[13])
            s = full@s
        # end of segment from the start state, no accumulation of half steps
        kk = (z, round(L*1e12), "L")
        if kk not in cache: cache[kk] = expm(aug[z]*L)
        y = cache[kk]@y
    return np.array(ts), np.array(ac), np.array(st).T, time.process_time()-t0


def atol_vec(rtol):
    a = np.array([1e-4]*4+[1e-6]*4+[1.0]*4+[1e-2]*4)
    return rtol*a


def run(kind, shape, method, rtol, T, mode, tgrid):
    rhs, kf = make_rhs(kind, shape)
    rhs(0.0, static(kind))                              # compile
    jac = None
    if method in ("Radau", "BDF", "LSODA"):
        jac = lambda t, y, zone=None: amat(kind, float(kf(t, zone)))
    y = static(kind); nf = 0; Ys = []; steps = 0
    at = atol_vec(rtol)
    t0 = time.process_time()
    if mode == "naive":
        kw = dict(jac=(lambda t, y: jac(t, y))) if jac else {}
        s = solve_ivp(lambda t, y: rhs(t, y), (0, T), y, method=method, rtol=rtol, atol=at, dense_output=True, **kw)
        cost = time.process_time()-t0
        if not s.success: return None
        nf = s.nfev; steps = len(s.t)-1
        Y = s.sol(tgrid)
    else:
        idx = 0; sols = []
        for (a, e, z) in segments(T):
            kw = dict(jac=(lambda t, y: jac(t, y, z))) if jac else {}
            s = solve_ivp(lambda t, y: rhs(t, y, z), (a, e), y, method=method, rtol=rtol, atol=at, dense_output=True, **kw)
            if not s.success: return None
            y = s.y[:, -1]; nf += s.nfev; steps += len(s.t)-1; sols.append((a, e, s.sol))
        cost = time.process_time()-t0
        Y = np.empty((16, len(tgrid)))
        for (a, e, so) in sols:
            m = (tgrid >= a) & (tgrid < e)
            if m.any(): Y[:, m] = so(tgrid[m])
    acc = y1acc(kind, kf, tgrid, Y)
    return cost/T, nf/T, steps/T, acc


def newmark(kind, shape, dt, T):
    """average-acceleration Newmark, dense 8x8 solve per step, numba if present"""
    K0, C0 = base(kind)
    n = int(round(T/dt)); t = np.arange(n+1)*dt
    kk = k_of(t, shape).astype(float)
    y = static(kind)
    out = np.empty(n+1)
    _newmark_core(kk[:3].copy(), dt, K0, C0, H, MASS, FEXT, ZETA_MESH, ME, y[:8].copy(), np.empty(3))
    t0 = time.process_time()
    _newmark_core(kk, dt, K0, C0, H, MASS, FEXT, ZETA_MESH, ME, y[:8].copy(), out)
    return t, out, (time.process_time()-t0)/T


@njit(cache=False)
def _newmark_core(kk, dt, K0, C0, Hv, mass, f, zeta, me, u, out):
    v = np.zeros(8); a = np.zeros(8)
    S = np.outer(Hv, Hv); Mm = np.diag(mass)
    k = kk[0]
    a = (f - (K0+k*S)@u)/mass
    out[0] = a[5]
    for i in range(1, len(kk)):
        k = kk[i]
        Ki = K0+k*S
        Ci = C0+2*zeta*np.sqrt(k*me)*S
        up = u+dt*v+0.25*dt*dt*a
        vp = v+0.5*dt*a
        a = np.linalg.solve(Mm+0.5*dt*Ci+0.25*dt*dt*Ki, f-Ki@up-Ci@vp)
        u = up+0.25*dt*dt*a
        v = vp+0.5*dt*a
        out[i] = a[5]
    return out


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--T", type=float, default=0.05)
    ap.add_argument("--reps", type=int, default=1)
    ap.add_argument("--quick", action="store_true")
    ap.add_argument("--brief", action="store_true", help="DOP853, LSODA and Radau at 1e-9 on the square wave, restarted at its jumps, as cargo xtask bench needs")
    a = ap.parse_args()
    T = round(a.T/TM)*TM
    print(f"python {sys.version.split()[0]} numpy {np.__version__} scipy {scipy.__version__} numba {HAVE_NUMBA}")
    print(f"rb1 {RB1*1e3:.4f} mm rb2 {RB2*1e3:.4f} mm  contact ratio {CR:.5f}  fm {FM:.1f} Hz  m_e(torsion) {ME:.4f} kg")
    global BODY, ROOT
    for (BODY, ROOT, lab) in ((False, False, "Tian 2004: cantilever from base circle, no gear body"),
                              (False, True, "cantilever from root circle, no gear body"),
                              (True, True, "cantilever from root circle + Sainsot body (USED)")):
        p = 2*np.pi/Z1; g = (np.arange(60)+0.5)/60
        kd = [pair_stiffness(t*(CR-1)*p)+pair_stiffness(t*(CR-1)*p+p) for t in g]
        ks = [pair_stiffness((CR-1)*p+t*(2-CR)*p) for t in g]
        print(f"  {lab}: double {np.mean(kd):.4e} single {np.mean(ks):.4e} N/m")
    BODY = ROOT = True
    print(f"used: double mean {K2:.5e} N/m, single mean {K1:.5e} N/m, ratio {K2/K1:.4f}")
    for f in (0.0, 0.25, 0.5, 0.75, 0.999):
        print(f"    k({f:5.3f} of double zone)={float(k_energy(np.array(f*TD))):.6e}   k({f:5.3f} of single zone)={float(k_energy(np.array(TD+1e-12+f*(TM-TD)*0.999))):.6e}")
    for kind in ("sane", "printed"):
        cp, cg, cb = damp(kind)
        ev = np.linalg.eigvals(amat(kind, K2))
        osc = sorted({round(abs(e)/2/np.pi, 1) for e in ev if abs(e.imag) > 1e-3})
        print(f"[{kind}] cp={cp:.4g} cg={cg:.4g} N m s/rad, cb={cb:.4g} N s/m  max|eig|={abs(ev).max():.4g} 1/s  "
              f"oscillatory modes Hz {osc}  fastest real decay {ev.real.min():.4g} 1/s")
    nper = 400
    methods = ("DOP853", "LSODA", "Radau") if a.brief else ("RK45", "DOP853", "LSODA", "BDF", "Radau")
    print(f"\nT={T:.6f} s ({T/TM:.0f} mesh periods), {nper} samples per zone for the error")
    cases = (("sane", "square"), ("sane", "energy"), ("printed", "square"))
    for kind, shape in cases[:1] if a.brief else cases:
        if shape == "square":
            tg, true, _, w = exact(kind, T, nper)
            print(f"\n== {kind} / {shape}: exact piecewise matrix exponential, Python loop, {len(tg)} samples: {w/T:.3f} s/s ({w/len(tg)*1e6:.2f} us/sample)")
        else:
            tg, _, _, _ = exact(kind, T, nper)
            r = run(kind, shape, "DOP853", 1e-13, T, "segment", tg)
            true = r[3]
            print(f"\n== {kind} / {shape}: reference = DOP853 segment rtol 1e-13 ({r[0]:.2f} s/s)")
        sc = np.std(true)
        print(f"   RMS(AC) of y1 acceleration {sc:.4f} m/s2, peak {abs(true-true.mean()).max():.3f}")
        print(f"   {'method':8s} {'rtol':>7s} {'mode':8s} {'s/s':>10s} {'nfev/s':>12s} {'steps/s':>11s} {'errA':>10s}")
        for m in methods:
            if kind == "printed" and m in ("RK45", "DOP853"):
                print(f"   {m:8s}  -- explicit: needs h < ~{3/1.5e9:.1e} s, i.e. >5e8 steps per simulated second; not run")
                continue
            for rtol in ((1e-9,) if a.brief else (1e-6,) if a.quick else (1e-6, 1e-9)):
                for mode in ("segment",) if a.brief else ("naive", "segment"):
                    best = None
                    for _ in range(a.reps):
                        r = run(kind, shape, m, rtol, T, mode, tg)
                        if r is None: break
                        best = r if best is None or r[0] < best[0] else best
                    if best is None:
                        print(f"   {m:8s} {rtol:7.0e} {mode:8s}   FAILED"); continue
                    err = np.sqrt(np.mean((best[3]-true)**2))/sc
                    print(f"   {m:8s} {rtol:7.0e} {mode:8s} {best[0]:10.3f} {best[1]:12.4g} {best[2]:11.4g} {err:10.2e}", flush=True)
        for dt in () if a.brief else (1e-5, 1e-6):
            t, acc, w = newmark(kind, shape, dt, T)
            ai = np.interp(tg, t, acc)
            print(f"   Newmark  dt={dt:.0e} numba={HAVE_NUMBA}: {w:8.3f} s/s  errA {np.sqrt(np.mean((ai-true)**2))/sc:.2e}")


if __name__ == "__main__":
    main()
